// The picture of a weight stack: Σ_k c_k φ_k of each pixel, with φ_k of all lamps already as display colours; then sRGB.
uniform usampler2D geometry;           // logarithm of the level, coverage, 0, label
uniform usampler2DArray components;    // whole numbers about MIDDLE, four components a layer
uniform vec3 columns[4 * LAYERS];      // display colour of a unit of each component
uniform vec2 levelRange;
uniform float exposure;
out vec4 shown;

const float MIDDLE = 32768.0, LEVEL_TOP = 4095.0, COVER_TOP = 255.0;

vec3 encoded(vec3 linear) {  // IEC 61966-2-1:1999
  vec3 u = clamp(linear, 0.0, 1.0);
  return mix(1.055 * pow(max(u, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055, 12.92 * u, vec3(lessThanEqual(u, vec3(0.0031308))));
}

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  uvec4 shape = texelFetch(geometry, pixel, 0);
  if (shape.w == 0u) { shown = vec4(0.0); return; }
  vec3 sum = vec3(0.0);
  for (int layer = 0; layer < LAYERS; layer++) {
    vec4 c = vec4(texelFetch(components, ivec3(pixel, layer), 0)) - MIDDLE;
    for (int k = 0; k < 4; k++) sum += c[k] * columns[4 * layer + k];
  }
  float level = sqrt(levelRange.x * pow(levelRange.y / levelRange.x, float(shape.x) / LEVEL_TOP));
  shown = vec4(encoded(exposure * level * sum), float(shape.y) / COVER_TOP);
}
