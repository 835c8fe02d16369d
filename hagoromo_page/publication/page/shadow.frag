// Share of each lamp that arrives at a point of the relief: rays to the lamps over the depth of a coarse picture.
uniform sampler2D relief;    // depth [m], 0 where there is nothing
uniform vec2 focal, centre;  // of the coarse picture [px]
uniform float nearest;       // least depth [m]
uniform int lampCount;
uniform vec4 lampAt[LAMPS];
out vec4 arriving;

const float SOFTNESS = 0.012;  // [rad] half width of the lamp
const float BIAS = 0.4;        // [px] by which the surface may stand above a ray near its start, none after 6 px

float arrivingFrom(vec4 lamp, vec3 start, ivec2 size) {
  vec3 way = lamp.w > 0.5 ? lamp.xyz - start : lamp.xyz;
  vec3 toLamp = normalize(way);
  float pixel = -start.z / focal.x, across = max(length(toLamp.xy), 0.02);
  float reach = lamp.w > 0.5 ? length(way) : 1e30, clearance = 1e3, steps = 1.5;
  for (int i = 0; i < 180; i++) {
    float t = steps * pixel / across;
    vec3 point = start + t * toLamp;
    if (t > reach || -point.z < nearest) break;
    vec2 place = vec2(point.x, -point.y) / -point.z * focal + centre - 0.5;
    ivec2 low = ivec2(floor(place));
    if (any(lessThan(low, ivec2(0))) || any(greaterThanEqual(low, size - 1))) break;
    vec2 share = place - vec2(low);
    float a = texelFetch(relief, low, 0).r, b = texelFetch(relief, low + ivec2(1, 0), 0).r;
    float c = texelFetch(relief, low + ivec2(0, 1), 0).r, d = texelFetch(relief, low + 1, 0).r;
    if (min(min(a, b), min(c, d)) > 0.0) {
      float surface = mix(mix(a, b, share.x), mix(c, d, share.x), share.y);
      clearance = min(clearance, (surface + point.z + BIAS * pixel * max(1.0 - steps / 6.0, 0.0)) / t);
      if (clearance < -SOFTNESS) break;
    }
    steps += max(0.7, 0.03 * steps);
  }
  return smoothstep(-SOFTNESS, SOFTNESS, clearance);
}

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy), size = textureSize(relief, 0);
  float depth = texelFetch(relief, pixel, 0).r;
  vec4 share = vec4(1.0);
  arriving = share;
  if (depth == 0.0) return;
  vec2 ray = (gl_FragCoord.xy - centre) / focal;
  vec3 start = vec3(ray.x, -ray.y, -1.0) * depth;
  for (int k = 0; k < lampCount; k++) share[k] = arrivingFrom(lampAt[k], start, size);
  arriving = share;
}
