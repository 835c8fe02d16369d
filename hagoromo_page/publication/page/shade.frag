// Dichromatic Torrance–Sparrow reflection of each pixel under up to LAMPS lamps, as linear sRGB, then as sRGB.
// Equation numbers are those of docs/model/reflection.md (MODEL §2). Axes: x right, y up, z to the eye.
uniform usampler2D geometry;       // octahedral normal u, v; depth; label
uniform usampler2DArray bodies;    // square roots of α c_b, four channels a layer
uniform usampler2D extra;          // ln β, ln γ, error of the normal + 256 · 1/ν, error of body colour or gloss
uniform usampler2D closely;        // curvature, occlusion: 1 … 255 over their scales, 0 unknown
uniform sampler2D materials;       // row 0: β, γ, n, 1/ν; row 1: 2^(1/ν) − 1, ε, σ, 1 without measured gloss; rows 2 …: interface colour under lamp k;
                                   // then of each further lobe β and γ over those of the first one
uniform sampler2D rays;            // x/z, y/z of rays on a grid over the picture (OpenCV's axes)
uniform sampler2D shadows;         // share of each lamp that arrives
uniform vec2 tileOrigin;           // place of the tile in its level [px]
uniform float levelFactor;         // width of a pixel of the level [px of the page]
uniform vec2 pageSize;             // [px]
uniform vec2 depthRange;           // [m]
uniform vec2 betaRange, gammaRange, tailRange, errorRange;
uniform float normalTop, bodyTop, bodyScale, glossTop, errorTop;
uniform int lampCount;
uniform vec4 lampAt[LAMPS];        // direction (w = 0) or position [m] (w = 1)
uniform vec4 lampAxis[LAMPS];      // axis and exponent of the fall-off; exponent 0: alike all around
uniform float lampScale[LAMPS];    // irradiance of a plane that faces the lamp; at 1 m of a near one
uniform vec3 bodyColumns[LAMPS * CHANNELS];  // display colour of a unit of α c_b of a channel
uniform vec3 stretchColumns[CHANNELS], stretchOffset;  // display colour of a unit of α c_b of a channel, and of none
uniform vec3 stops[3];             // colours of the ends and the middle of a scale
uniform int view;
uniform bool ofGloss;              // whether the view shows the gloss, or its error
uniform float exposure, albedoFactor;
uniform bool withShadows;
uniform float enhancement, enhancementWidth;
out vec4 shown;

const float PI = 3.14159265358979;

vec3 octahedralNormal(vec2 o) {
  vec3 n = vec3(o, 1.0 - abs(o.x) - abs(o.y));
  if (n.z < 0.0) n.xy = (1.0 - abs(n.yx)) * vec2(n.x < 0.0 ? -1.0 : 1.0, n.y < 0.0 ? -1.0 : 1.0);
  return normalize(n);
}

vec2 rayAt(vec2 place) {  // bilinear, exact for a lens without distortion
  ivec2 cells = textureSize(rays, 0) - 1;
  vec2 at = clamp(place / pageSize, 0.0, 1.0) * vec2(cells);
  ivec2 low = clamp(ivec2(at), ivec2(0), cells - 1);
  vec2 share = at - vec2(low);
  vec2 a = texelFetch(rays, low, 0).xy, b = texelFetch(rays, low + ivec2(1, 0), 0).xy;
  vec2 c = texelFetch(rays, low + ivec2(0, 1), 0).xy, d = texelFetch(rays, low + 1, 0).xy;
  return mix(mix(a, b, share.x), mix(c, d, share.x), share.y);
}

float logarithmic(uint whole, float top, vec2 range) {
  return range.x * pow(range.y / range.x, float(whole) / top);
}

// φ² [rad²] between normal and half vector; by the series of arcsin² where cosφ has lost its digits
float squaredAngle(vec3 normal, vec3 sum) {
  vec3 across = cross(normal, sum);
  float x = dot(across, across) / dot(sum, sum), cosine = dot(normal, sum);
  if (x < 0.04 && cosine > 0.0) return x * (1.0 + x * (1.0 / 3.0 + x * (8.0 / 45.0 + x * (4.0 / 35.0 + x * 0.0812699))));
  float angle = atan(length(across), cosine);
  return angle * angle;
}

// (4) D = exp(−ln2 φ²/γ²), with tails D = (1 + (2^(1/ν) − 1) φ²/γ²)^(−ν)
float facets(float squared, float gamma, float tail, float rise) {
  float x = squared / (gamma * gamma);
  return tail > 0.0 ? exp(-log(1.0 + rise * x) / tail) : exp2(-x);
}

// (5) Fresnel reflectance of a dielectric
float fresnel(float c, float n) {
  float g = sqrt(n * n + c * c - 1.0);
  float a = (g - c) / (g + c), b = (c * (g + c) - 1.0) / (c * (g - c) + 1.0);
  return 0.5 * a * a * (1.0 + b * b);
}

// (cosθ_i cosθ_r)^ε (1 + σ s/t): how the body departs from Lambert's law (hagoromo/reflectance/body.py)
float bodyFactor(float cosLamp, float cosView, float phase, float epsilon, float sigma) {
  if (epsilon == 0.0 && sigma == 0.0) return 1.0;
  float s = phase - cosLamp * cosView, t = s > 0.0 ? max(max(cosLamp, cosView), 0.02) : 1.0;
  return pow(max(cosLamp, 0.02) * max(cosView, 0.02), epsilon) * max(1.0 + sigma * s / t, 0.0);
}

vec3 encoded(vec3 linear) {  // IEC 61966-2-1:1999
  vec3 u = clamp(linear, 0.0, 1.0);
  return mix(1.055 * pow(max(u, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055, 12.92 * u, vec3(lessThanEqual(u, vec3(0.0031308))));
}

vec3 viridis(float t) {  // a polynomial of the map of van der Walt and Smith
  const vec3 a = vec3(0.2777, 0.0054, 0.3341), b = vec3(0.1051, 1.4046, 1.3846), c = vec3(-0.3309, 0.2148, 0.0951);
  const vec3 d = vec3(-4.6342, -5.7991, -19.3324), e = vec3(6.2283, 14.1799, 56.6906), f = vec3(4.7764, -13.7451, -65.353);
  const vec3 g = vec3(-5.4355, 4.6459, 26.3124);
  return clamp(a + t * (b + t * (c + t * (d + t * (e + t * (f + t * g))))), 0.0, 1.0);
}

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  uvec4 shape = texelFetch(geometry, pixel, 0);
  if (shape.w == 0u) { shown = vec4(0.0); return; }
  int label = int(shape.w) - 1;
  vec3 normal = octahedralNormal(2.0 * vec2(shape.xy) / normalTop - 1.0);
  if (view == 1) { shown = vec4(0.5 + 0.5 * normal, 1.0); return; }
  uvec4 more = texelFetch(extra, pixel, 0);
  vec4 interfaceOf = texelFetch(materials, ivec2(label, 0), 0), bodyOf = texelFetch(materials, ivec2(label, 1), 0);
  float beta = betaRange.x > 0.0 ? logarithmic(more.x, glossTop, betaRange) : interfaceOf.x;
  float gamma = gammaRange.x > 0.0 ? logarithmic(more.y, glossTop, gammaRange) : interfaceOf.y;
  float tail = interfaceOf.w, rise = bodyOf.x;
  if (tailRange.y > 0.0) {
    tail = mix(tailRange.x, tailRange.y, float(more.z >> 8) / 255.0);
    tail = tail < 1e-3 ? 0.0 : tail;
    rise = exp2(tail) - 1.0;
  }
  float facing = (interfaceOf.z - 1.0) / (interfaceOf.z + 1.0);
  if (ofGloss && bodyOf.w > 0.5) { shown = vec4(vec3(0.3), 1.0); return; }
  if (view == 7 || view == 8) {
    uvec4 whole = texelFetch(closely, pixel, 0);
    uint code = view == 7 ? whole.x : whole.y;
    float t = 2.0 * (float(code) - 1.0) / 254.0;
    shown = vec4(code == 0u ? vec3(0.3) : mix(mix(stops[0], stops[1], t), mix(stops[1], stops[2], t - 1.0), step(1.0, t)), 1.0);
    return;
  }
  if (view >= 3 && view < 7) {
    float value = view == 3 ? gamma : view == 4 ? beta * facing * facing
      : errorRange.x > 0.0 ? logarithmic(view == 5 ? more.z & 255u : more.w, errorTop, errorRange) : 0.0;
    vec2 range = view >= 5 ? errorRange : view == 3 ? SCALE_GAMMA : SCALE_PEAK;
    shown = vec4(viridis(clamp(log(value / range.x) / log(range.y / range.x), 0.0, 1.0)), 1.0);
    return;
  }
  float body[CHANNELS];
  for (int c = 0; c < CHANNELS; c++) {
    float root = float(texelFetch(bodies, ivec3(pixel, c / 4), 0)[c % 4]) / bodyTop;
    body[c] = bodyScale * root * root;
  }
  if (view == 9) {
    vec3 apart = stretchOffset;
    for (int c = 0; c < CHANNELS; c++) apart += body[c] * stretchColumns[c];
    shown = vec4(clamp(apart, 0.0, 1.0), 1.0);
    return;
  }
  if (view == 2) {
    vec3 albedo = vec3(0.0);
    for (int c = 0; c < CHANNELS; c++) albedo += PI * body[c] * bodyColumns[c];
    shown = vec4(encoded(albedoFactor * albedo), 1.0);
    return;
  }
  vec2 place = (tileOrigin + gl_FragCoord.xy) * levelFactor;
  vec2 ray = rayAt(place);
  vec3 forward = vec3(ray.x, -ray.y, -1.0);
  float depth = mix(depthRange.x, depthRange.y, float(shape.z) / 65535.0);
  vec3 point = forward * depth, toEye = normalize(-forward);
  vec4 arriving = withShadows ? texture(shadows, place / pageSize) : vec4(1.0);
  float cosView = dot(normal, toEye);
  vec3 sum = vec3(0.0);
  for (int k = 0; k < lampCount; k++) {
    vec3 toLamp = lampAt[k].xyz;
    float irradiance = lampScale[k] * arriving[k];
    if (lampAt[k].w > 0.5) {
      vec3 offset = lampAt[k].xyz - point;
      toLamp = normalize(offset);
      irradiance /= dot(offset, offset);
      if (lampAxis[k].w > 0.0) irradiance *= pow(max(dot(-toLamp, lampAxis[k].xyz), 0.0), lampAxis[k].w);
    }
    float cosLamp = dot(normal, toLamp);
    if (cosLamp <= 0.0 || cosView <= 0.0) continue;
    vec3 both = toLamp + toEye;
    float cosDeviation = max(0.5 * length(both), 1e-6), cosHalf = dot(normal, both) / (2.0 * cosDeviation);
    float squared = squaredAngle(normal, both);
    // (6) G = min{1, 2 cosφ cosθ_r/cosθ_Q, 2 cosφ cosθ_i/cosθ_Q}
    float masking = min(1.0, 2.0 * cosHalf * min(cosView, cosLamp) / cosDeviation);
    float density = facets(squared, gamma, tail, rise);  // of all lobes, in units of β
    for (int l = 0; l < LOBES; l++) {
      vec2 lobe = texelFetch(materials, ivec2(label, 2 + LAMPS + l), 0).xy;
      density += lobe.x * facets(squared, gamma * lobe.y, 0.0, 0.0);
    }
    // (2)(3) f = α cosθ_i c_b + β D F G / cosθ_r e
    float interfaceWeight = beta * density * fresnel(cosDeviation, interfaceOf.z) * masking / cosView;
    float bodyWeight = cosLamp * bodyFactor(cosLamp, cosView, dot(toLamp, toEye), bodyOf.y, bodyOf.z);
    vec3 colour = vec3(0.0);
    for (int c = 0; c < CHANNELS; c++) colour += body[c] * bodyColumns[k * CHANNELS + c];
    vec3 radiance = (1.0 - enhancement) * bodyWeight * colour
      + interfaceWeight * texelFetch(materials, ivec2(label, 2 + k), 0).rgb;
    radiance += enhancement * 0.25 * exp2(-squared / (enhancementWidth * enhancementWidth));
    sum += irradiance * radiance;
  }
  shown = vec4(encoded(exposure * sum), 1.0);
}
