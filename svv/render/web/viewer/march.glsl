#version 300 es
// One ray a pixel through the scene's fields; the same optics as the renderer of the scene (svv/fields/rendering.py).
// Before compiling, draw.js sets REGIONS, WEIGHTS and LIGHTS (numbers of textures), LIT (0 none, 1 harmonics, 2 Blinn-Phong),
// PAINTED, STROKES, BY_REGION and constants; it repeats a line that begins with @WEIGHTS or @LIGHTS for each texture, # being its
// number. Textures are (z, y, x): the scene's arrays are in raster order with z fastest.
precision highp float;
precision highp int;
precision highp sampler3D;
precision highp usampler3D;

uniform mat3 uAxes;       // the camera's axes in the world: right, up, backwards
uniform vec3 uPosition;   // of the camera, in box coordinates
uniform vec4 uLens;       // focal length in pixels, column and row of the axis, 1 for parallel rays
uniform vec2 uPixel;      // pixels of the lens per pixel drawn
uniform vec3 uExtent;     // sides of the box, in box units
uniform float uCells;     // occupancy cells per box unit
uniform vec3 uMarch;      // sample distance in box units, weight up to which samples are joined, optical depth to stop at
uniform vec3 uBackground;

uniform usampler3D uLeaps;
uniform sampler3D uExtinction, uDiffuse;
uniform vec4 uExtinctionGrid, uColourGrid, uLightGrid, uPaintGrid; // cells per box unit, number of vertices along z, y, x
uniform vec2 uExtinctionCode; // value where the texture is 0, range of values
uniform float uDiffuseTop;    // value where the texture is 1
@WEIGHTS uniform sampler3D uWeights#;
@LIGHTS uniform sampler3D uLight#;
uniform float uOpacity[REGIONS];
uniform vec3 uLight[REGIONS];   // how each region responds to light: factor, scale of the shade, less specular
#if LIT == 1
uniform vec4 uShade[LIGHTS * BASIS], uSpecular[LIGHTS * BASIS]; // what a texture's channels count for, in each harmonic
uniform vec2 uLightZero[BASIS];                                 // shade and specular light where all channels are 0
#elif LIT == 2
uniform vec3 uNormalLow, uNormalRange;
uniform vec4 uReflects[REGIONS]; // ambient, diffuse, specular, shininess
uniform mat3 uLamp;              // turns directions towards the viewer into directions towards the light
uniform vec4 uSun;               // direction towards a light that stays in the world; w is 1 if there is one
uniform vec2 uLampHow;           // brightness; 1 if the headlight shines along the camera's axis
#endif
#if PAINTED
uniform sampler3D uPaint;
uniform float uShare[REGIONS];  // how strongly paint covers each region
uniform vec4 uStrokes[REGIONS]; // how extinction follows strokes: gain, slope, mean, reach
#endif

out vec4 pixel;

const float CEILING = 9.0; // greatest logarithm of the extinction

vec3 onGrid(vec3 p, vec4 grid) { return (p.zyx * grid.x + 0.5) / grid.yzw; }

#if LIT == 1
// What each texture's channels count for along the ray.
vec4 shadeOf[LIGHTS], specularOf[LIGHTS];
vec2 lightAtZero;

void prepare(vec3 d) {
  float basis[9]; // spherical harmonics, bands 0 to 2 (svv/core/encodings.py)
  basis[0] = 0.28209479177387814;
  basis[1] = -0.48860251190291987 * d.y;
  basis[2] = 0.48860251190291987 * d.z;
  basis[3] = -0.48860251190291987 * d.x;
  basis[4] = 1.0925484305920792 * d.x * d.y;
  basis[5] = -1.0925484305920792 * d.y * d.z;
  basis[6] = 0.94617469575755997 * d.z * d.z - 0.31539156525251999;
  basis[7] = -1.0925484305920792 * d.x * d.z;
  basis[8] = 0.54627421529603959 * (d.x * d.x - d.y * d.y);
  lightAtZero = vec2(0.0);
  for (int k = 0; k < BASIS; k++) lightAtZero += basis[k] * uLightZero[k];
  for (int t = 0; t < LIGHTS; t++) {
    shadeOf[t] = specularOf[t] = vec4(0.0);
    for (int k = 0; k < BASIS; k++) {
      shadeOf[t] += basis[k] * uShade[t * BASIS + k];
      specularOf[t] += basis[k] * uSpecular[t * BASIS + k];
    }
  }
}

// Shade and specular grey at a place.
vec2 lightAt(vec3 p) {
  vec3 q = onGrid(p, uLightGrid);
  vec2 light = lightAtZero;
  vec4 v;
@LIGHTS   v = texture(uLight#, q); light += vec2(dot(shadeOf[#], v), dot(specularOf[#], v));
  return clamp(light, vec2(0.0), vec2(2.0, 1e4));
}
#elif LIT == 2
vec3 facing, toward;

void prepare(vec3 d) {
  facing = uLampHow.y > 0.5 ? uAxes[2] : -d;
  toward = uSun.w > 0.5 ? uSun.xyz : uLamp * facing;
}

// Shade and specular grey of a surface that reflects with these coefficients (svv/core/light.py, blinn_phong).
vec2 lightAt(vec3 p, vec4 reflects) {
  vec3 v = uNormalLow + uNormalRange * texture(uLight0, onGrid(p, uLightGrid)).xyz;
  vec3 normal = v * inversesqrt(SOFTNESS * SOFTNESS + dot(v, v));
  float rim = RIM * clamp(1.0 - dot(facing, toward), 0.0, 1.0);
  float side = dot(normal, facing) < -rim ? -1.0 : 1.0;
  float cosine = max(side * dot(normal, toward), 0.0);
  vec3 between = toward + facing;
  float highlight = pow(max(side * dot(normal, between) * inversesqrt(max(dot(between, between), 1e-24)), 1e-4), reflects.w);
  return vec2(reflects.x + uLampHow.x * reflects.y * cosine, cosine > 0.0 ? uLampHow.x * reflects.z * highlight : 0.0);
}
#endif

// The colour of a place and, in w, the factor on its extinction.
vec4 shaded(vec3 p) {
  vec3 q = onGrid(p, uColourGrid);
  int region = 0;
#if WEIGHTS > 0 && (BY_REGION || LIT == 2)
  float weight[4 * WEIGHTS];
  vec4 w;
  int n = 0;
@WEIGHTS   w = texture(uWeights#, q); for (int k = 0; k < 4; k++) weight[n++] = w[k];
  for (int k = 1; k < REGIONS; k++) if (weight[k] > weight[region]) region = k;
#endif
  float factor = uOpacity[region];
  vec3 colour = vec3(0.0);
#if PAINTED
  float share = uShare[region];
  if (share < 1.0) colour = uDiffuseTop * texture(uDiffuse, q).rgb;
  if (share > 0.0) {
    vec3 paint = texture(uPaint, onGrid(p, uPaintGrid)).rgb;
    colour = mix(colour, paint, share);
#if STROKES
    vec4 s = uStrokes[region];
    factor *= exp(s.x + clamp(s.y * (s.z - dot(paint, vec3(0.2126, 0.7152, 0.0722))), -s.w, s.w));
#endif
  }
#else
  colour = uDiffuseTop * texture(uDiffuse, q).rgb;
#endif
#if LIT > 0
  vec3 how = uLight[region];
  if (how.x == 0.0) return vec4(colour, factor);
#if LIT == 1
  vec2 light = lightAt(p);
#elif WEIGHTS > 0
  vec4 reflects = vec4(0.0);
  float whole = 0.0;
  for (int k = 0; k < REGIONS; k++) { reflects += weight[k] * uReflects[k]; whole += weight[k]; }
  vec2 light = lightAt(p, reflects / whole);
#else
  vec2 light = lightAt(p, uReflects[0]);
#endif
  colour = colour * max(1.0 + how.x * (how.y * light.x - 1.0), 0.0) + how.x * (light.y - how.z);
#endif
  return vec4(colour, factor);
}

void main() {
  vec2 at = (gl_FragCoord.xy * uPixel - uLens.yz) / uLens.x;
  bool parallel = uLens.w > 0.5;
  vec3 o = parallel ? uPosition + uAxes * vec3(at, 0.0) : uPosition;
  vec3 d = normalize(uAxes * vec3(parallel ? vec2(0.0) : at, -1.0));
  d = mix(d, vec3(1e-9), lessThan(abs(d), vec3(1e-9)));
  vec3 a = -o / d, b = (uExtent - o) / d, low = min(a, b), high = max(a, b);
  float near = max(max(low.x, low.y), max(low.z, 0.0)), far = min(high.x, min(high.y, high.z));
  vec3 sum = vec3(0.0);
  float front = 1.0;
  if (near < far) {
    ivec3 most = textureSize(uLeaps, 0).zyx - 1;
    vec3 ahead = step(0.0, d);
#if LIT > 0
    prepare(d);
#endif
    float pace = uMarch.x, waiting = 0.0, factor = -1.0; // optical depth since the last shaded sample, and its factor
    vec3 place;
    int i = int(ceil(near / pace - 0.5)), last = int(floor(far / pace - 0.5));
    while (i <= last) {
      vec3 p = o + (float(i) + 0.5) * pace * d;
      ivec3 cell = clamp(ivec3(p * uCells), ivec3(0), most);
      float empty = float(texelFetch(uLeaps, cell.zyx, 0).r);
      if (empty > 0.0) {
        // On to the first sample behind the cube of empty cells around this one.
        vec3 wall = (vec3(cell) + mix(vec3(1.0 - empty), vec3(empty), ahead)) / uCells;
        vec3 exits = (wall - o) / d;
        i = max(i + 1, int(ceil(min(exits.x, min(exits.y, exits.z)) / pace - 0.5)));
        continue;
      }
      i++;
      place = clamp(p, vec3(0.0), uExtent);
      float code = texture(uExtinction, onGrid(place, uExtinctionGrid)).r;
      float thickness = exp(min(uExtinctionCode.x + uExtinctionCode.y * code, CEILING)) * pace + waiting;
      waiting = thickness;
      if (front * thickness < uMarch.y || front * (1.0 - exp(-thickness)) < uMarch.y) continue;
      waiting = 0.0;
      vec4 found = shaded(place);
      factor = found.a;
      float through = exp(-thickness * factor);
      sum += front * (1.0 - through) * found.rgb;
      front *= through;
      if (front < uMarch.z) break;
    }
    if (waiting > 0.0) front *= exp(-waiting * (factor < 0.0 ? shaded(place).a : factor));
  }
  float alpha = 1.0 - front;
  vec3 mean = alpha > 1.0 / 512.0 ? clamp(sum / alpha, 0.0, 1.0) * alpha : vec3(0.0);
  pixel = vec4(mean + uBackground * (alpha > 1.0 / 512.0 ? front : 1.0), 1.0);
}
