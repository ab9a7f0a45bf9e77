#version 300 es
// One ray a pixel through the fields of all layers; the same optics as the renderer (svv/fields/rendering.py, joined.py): each layer
// has samples of its own, and those of all are composited in the order of their distances.
// Before compiling, draw.js sets LAYERS, REGIONS (of all layers), WEIGHTS and LIGHTS (numbers of textures), LIT (bits: 1 harmonics,
// 2 Blinn-Phong, 4 not the same in all layers), PAINTED, STROKES, MATCAPS (how many), BY_REGION and constants; it repeats a line that begins with
// @WEIGHTS or @LIGHTS for each texture, # being its number. With PLACE, the pixel tells what it shows instead of its colour; with DOUBT,
// it has its colour over white and its expected error; with LINES, it also tells what lines.js takes. Textures are (z, y, x): the scene's arrays are in raster order with z
// fastest; in each, the grids of all layers lie one behind the other along x.
precision highp float;
precision highp int;
precision highp sampler3D;
precision highp usampler3D;

uniform mat3 uAxes;       // the camera's axes in the world: right, up, backwards
uniform vec4 uLens;       // focal length in pixels, column and row of the axis, 1 for parallel rays
uniform vec2 uPixel;      // pixels of the lens per pixel drawn
uniform float uStop;      // transmittance at which a ray ends
uniform vec3 uBackground;
uniform mat3 uLamp;       // turns directions towards the viewer into directions towards the light
uniform vec4 uSun;        // direction towards a light that stays in the world; w is 1 if there is one
uniform float uBrightness;
#if LINES
uniform float uUnit;      // size of the first layer's box in world units
#endif

uniform usampler3D uLeaps;
uniform sampler3D uExtinction, uDiffuse;
@WEIGHTS uniform sampler3D uWeights#;
@LIGHTS uniform sampler3D uLight#;
#if PAINTED
uniform sampler3D uPaint;
#endif
#if MATCAPS
uniform sampler3D uMatcaps; // pictures of lit spheres, one behind the other
#endif
#if DOUBT
uniform sampler3D uDoubt;   // errors of cells, as parts of the largest
uniform vec3 uDoubtSize;    // cells per box unit, by numbers of cells along z, y, x
#endif
#if SHADOWS
uniform sampler3D uShadows; // how much of the light arrives
uniform vec3 uShadowsSize;
uniform vec2 uShadowsGrid[LAYERS]; // cells per box unit and begin of each layer's lattice
uniform float uShadow;      // how far shadows darken
#endif
uniform vec3 uExtinctionSize, uColourSize, uLightSize, uPaintSize; // numbers of vertices of the textures along z, y, x

// Lengths are in box units of each layer. "Begin": where along x its grid begins in a texture.
layout(std140) uniform Tables {
  vec4 uPosition[LAYERS]; // of the camera, in box coordinates; size of the box relative to the first layer's
  vec4 uBox[LAYERS];      // sides of the box; occupancy cells per box unit
  vec4 uCells[LAYERS];    // numbers of occupancy cells along x, y, z; begin
  vec4 uMarch[LAYERS];    // sample distance; the same in the first layer's box units; weight up to which samples are joined; 1 if visible
  vec4 uKind[LAYERS];     // number of its first region, number of regions, light (as in LIT), 1 if its headlight shines along the camera's axis
  vec4 uCode[LAYERS];     // extinction where the texture is 0, its range; diffuse colour where the texture is 1
  vec4 uGrid[LAYERS];     // cells per box unit and begin of the extinction's grid, and of the colours'
  vec4 uGrid2[LAYERS];    // the same of the light's grid, and of the paint's
  vec4 uNormalLow[LAYERS], uNormalRange[LAYERS];
  vec4 uRegion[REGIONS];   // factor on the extinction; how it responds to light: factor, scale of the shade, less specular
  vec4 uReflects[REGIONS]; // ambient, diffuse, specular, shininess
  vec4 uStrokes[REGIONS];  // how extinction follows strokes: gain, slope, mean, reach
  vec4 uShare[REGIONS];    // how strongly paint covers it; number of its MatCap from 1, 0 for none
  vec4 uShade[LAYERS * LIGHTS * BASIS], uSpecular[LAYERS * LIGHTS * BASIS]; // what a texture's channels count for, in each harmonic
  vec4 uLightZero[LAYERS * BASIS];                                          // shade and specular light where all channels are 0
};

const float BEYOND = 1e30; // farther than any sample

#if CUTS
// Of each cut: planes n . x > d in box coordinates of each layer; centre and radius, and axis, of a ball or cylinder; number of planes,
// 1 for a ball and 2 for a cylinder, 1 if what is outside is cut off instead.
layout(std140) uniform Cuts {
  vec4 uCutPlanes[LAYERS * CUTS * 6];
  vec4 uCutBall[LAYERS * CUTS], uCutAxis[LAYERS * CUTS], uCutKind[CUTS];
};
#if CUTS_BY_REGION
uniform int uCutRegions[CUTS];  // regions that are cut, as bits; 0 for all
uniform vec4 uSection[REGIONS]; // unlit colour of its sections; 0 as learned, 1 flat, 2 hatched
#endif

// How deep a place lies in what a cut takes away; negative outside (Cut.depth).
float cutDepth(int l, int c, vec3 p) {
  vec4 kind = uCutKind[c];
  float depth = 1e9;
  for (int k = 0; k < 6; k++) {
    if (float(k) >= kind.x) break;
    vec4 plane = uCutPlanes[(l * CUTS + c) * 6 + k];
    depth = min(depth, dot(plane.xyz, p) - plane.w);
  }
  if (kind.y > 0.5) {
    vec4 ball = uCutBall[l * CUTS + c];
    vec3 away = p - ball.xyz, axis = uCutAxis[l * CUTS + c].xyz;
    if (kind.y > 1.5) away -= dot(away, axis) * axis;
    depth = min(depth, ball.w - length(away));
  }
  return kind.z > 0.5 ? -depth : depth;
}

// Where the ray enters and leaves the shape of each cut, in box units of each layer; beyond all if it misses it (Cut.span).
vec2 spans[LAYERS * CUTS];

vec2 spanOf(int l, int c, vec3 o, vec3 d) {
  vec4 kind = uCutKind[c];
  float near = -BEYOND, far = BEYOND;
  for (int k = 0; k < 6; k++) {
    if (float(k) >= kind.x) break;
    vec4 plane = uCutPlanes[(l * CUTS + c) * 6 + k];
    float slope = dot(plane.xyz, d), rest = plane.w - dot(plane.xyz, o);
    if (slope > 0.0) near = max(near, rest / slope);
    else if (slope < 0.0) far = min(far, rest / slope);
    else if (rest >= 0.0) far = -BEYOND;
  }
  if (kind.y > 0.5) {
    vec4 ball = uCutBall[l * CUTS + c];
    vec3 away = o - ball.xyz, along = d, axis = uCutAxis[l * CUTS + c].xyz;
    if (kind.y > 1.5) away -= dot(away, axis) * axis, along -= dot(along, axis) * axis;
    float slope = dot(along, along), middle = slope > 1e-12 ? -dot(away, along) / slope : 0.0;
    away += middle * along;
    float rest = ball.w * ball.w - dot(away, away);
    if (rest <= 0.0) far = -BEYOND;
    else if (slope > 1e-12) near = max(near, middle - sqrt(rest / slope)), far = min(far, middle + sqrt(rest / slope));
  }
  return near < far ? vec2(near, far) : vec2(BEYOND);
}

// The piece of the ray that begins at a distance, or at the first one behind it that cuts of all regions leave; it ends at the next
// face of any cut (divide_rays).
vec2 pieceFrom(int l, float from) {
  bool gone = true;
  for (int turn = 0; gone && turn < CUTS; turn++) {
    gone = false;
    for (int c = 0; c < CUTS; c++) {
#if CUTS_BY_REGION
      if (uCutRegions[c] != 0) continue;
#endif
      vec2 span = spans[l * CUTS + c];
      bool inside = from >= span.x && from < span.y, outside = uCutKind[c].z > 0.5;
      if (inside == outside) continue;
      from = inside ? span.y : from < span.x ? span.x : BEYOND;
      gone = true;
    }
  }
  float end = BEYOND;
  for (int c = 0; c < CUTS; c++) {
    vec2 span = spans[l * CUTS + c];
    if (span.x > from) end = min(end, span.x);
    if (span.y > from) end = min(end, span.y);
  }
  return vec2(from, end);
}

#if CUTS_BY_REGION
// Whether a place of a region is cut off by a cut of some regions.
bool isCut(int l, vec3 p, int region) {
  for (int c = 0; c < CUTS; c++) if ((uCutRegions[c] & (1 << region)) != 0 && cutDepth(l, c, p) > 0.0) return true;
  return false;
}
#endif
#endif

#if DOUBT
out uvec4 pixel; // of 16 bits: those of bytes would show as lines where neighbours differ by one level
#else
layout(location = 0) out vec4 pixel;
#endif
#if LINES
layout(location = 1) out uvec4 told; // the bits of alpha and the mean distance, the region from 1, the bits of the part from faces of cuts
#endif

const float CEILING = 9.0; // greatest logarithm of the extinction

#if PLACE || CUTS || LINES
float faceShaded = 0.0; // how far it shows the face of a cut
int regionShaded; // the region of the place that was shaded last
#endif

// The number of a layer, that of its first region, and how many it has: of a single layer, compilers know them.
#if LAYERS == 1
#define L 0
#define FIRST 0
#define COUNT REGIONS
#else
#define L l
#define FIRST int(uKind[l].x)
#define COUNT int(uKind[l].y)
#endif

// The light of a layer, which compilers know if it is the same in all.
#if LIT < 3
#define KIND LIT
#else
#define KIND int(uKind[L].z)
#endif

vec3 onGrid(vec3 p, vec2 grid, vec3 size) { return (p.zyx * grid.x + vec3(0.5, 0.5, grid.y + 0.5)) / size; }

#if (LIT & 1) != 0
// What each texture's channels count for along the ray.
vec4 shadeOf[LAYERS * LIGHTS], specularOf[LAYERS * LIGHTS];
vec2 lightAtZero[LAYERS];

void prepareHarmonics(vec3 ray) {
  for (int l = 0; l < LAYERS; l++) {
    vec3 d = uKind[l].w > 0.5 ? -uAxes[2] : ray;
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
    lightAtZero[l] = vec2(0.0);
    for (int k = 0; k < BASIS; k++) lightAtZero[l] += basis[k] * uLightZero[l * BASIS + k].xy;
    for (int t = l * LIGHTS; t < (l + 1) * LIGHTS; t++) {
      shadeOf[t] = specularOf[t] = vec4(0.0);
      for (int k = 0; k < BASIS; k++) {
        shadeOf[t] += basis[k] * uShade[t * BASIS + k];
        specularOf[t] += basis[k] * uSpecular[t * BASIS + k];
      }
    }
  }
}

// Shade and specular grey at a place.
vec2 harmonicLight(int l, vec3 p) {
  vec3 q = onGrid(p, uGrid2[L].xy, uLightSize);
  vec2 light = lightAtZero[L];
  vec4 v;
@LIGHTS   v = texture(uLight#, q); light += vec2(dot(shadeOf[L * LIGHTS + #], v), dot(specularOf[L * LIGHTS + #], v));
  return clamp(light, vec2(0.0), vec2(2.0, 1e4));
}
#endif
#if (LIT & 2) != 0
vec3 facing[LAYERS], toward[LAYERS];

void prepareLamp(vec3 d) {
  for (int l = 0; l < LAYERS; l++) {
    facing[l] = uKind[l].w > 0.5 ? uAxes[2] : -d;
    toward[l] = uSun.w > 0.5 ? uSun.xyz : uLamp * facing[l];
  }
}

// Shade and specular grey of a surface that reflects with these coefficients (svv/core/light.py, blinn_phong).
vec2 lampLight(int l, vec3 p, vec4 reflects) {
  vec3 v = uNormalLow[L].xyz + uNormalRange[L].xyz * texture(uLight0, onGrid(p, uGrid2[L].xy, uLightSize)).xyz;
  vec3 normal = v * inversesqrt(SOFTNESS * SOFTNESS + dot(v, v));
  float rim = RIM * clamp(1.0 - dot(facing[L], toward[L]), 0.0, 1.0);
  float side = dot(normal, facing[L]) < -rim ? -1.0 : 1.0;
  float cosine = max(side * dot(normal, toward[L]), 0.0);
  vec3 between = toward[L] + facing[L];
  float highlight = pow(max(side * dot(normal, between) * inversesqrt(max(dot(between, between), 1e-24)), 1e-4), reflects.w);
  return vec2(reflects.x + uBrightness * reflects.y * cosine, cosine > 0.0 ? uBrightness * reflects.z * highlight : 0.0);
}
#endif

#if MATCAPS
vec3 viewer[LAYERS]; // directions towards the viewer

void prepareMatcaps(vec3 d) {
  for (int l = 0; l < LAYERS; l++) viewer[l] = uKind[l].w > 0.5 ? uAxes[2] : -d;
}

// The power of the extinction whose gradient gives normals (svv/fields/phong.py).
float softened(int l, vec3 p) {
  return exp(EXTINCTION_POWER * (uCode[L].x + uCode[L].y * texture(uExtinction, onGrid(p, uGrid[L].xy, uExtinctionSize)).r));
}

vec3 normalAt(int l, vec3 p) {
#if (LIT & 2) != 0
  if (KIND == 2) {
    vec3 v = uNormalLow[L].xyz + uNormalRange[L].xyz * texture(uLight0, onGrid(p, uGrid2[L].xy, uLightSize)).xyz;
    return v * inversesqrt(SOFTNESS * SOFTNESS + dot(v, v));
  }
#endif
  vec3 down = vec3(0.0);
  for (int axis = 0; axis < 3; axis++)
    for (float k = 1.0; k < 3.5; k++) { // as the derivative of a Gaussian two cells wide weighs them
      vec3 away = vec3(0.0);
      away[axis] = 1.25 * k / uGrid[L].x;
      down[axis] += k * exp(-0.1953 * k * k) * (softened(l, p - away) - softened(l, p + away));
    }
  return down / (length(down) + 1e-3);
}

// The colour of a MatCap at a place (svv/core/matcaps.py).
vec3 matcapColour(int l, vec3 p, float number) {
  vec3 normal = normalAt(l, p), across = normalize(cross(uAxes[1], viewer[L])), above = cross(viewer[L], across);
  vec2 at = (dot(normal, viewer[L]) < BEHIND ? -1.0 : 1.0) * vec2(dot(normal, across), dot(normal, above));
  at *= INSET / max(length(at), 1.0);
  return texture(uMatcaps, vec3(0.5 + 0.5 * at.x, 0.5 - 0.5 * at.y, (number - 0.5) / float(MATCAPS))).rgb;
}
#endif

// The colour of a place in a layer without shadows and, in w, the factor on its extinction, wherever cuts are.
vec4 unshadowed(int l, vec3 p) {
  vec3 q = onGrid(p, uGrid[L].zw, uColourSize);
  int region = 0; // of the layer
#if WEIGHTS > 0 && (BY_REGION || (LIT & 2) != 0)
  float weight[4 * WEIGHTS];
  vec4 w;
  int n = 0;
@WEIGHTS   w = texture(uWeights#, q); for (int k = 0; k < 4; k++) weight[n++] = w[k];
  for (int k = 1; k < COUNT; k++) if (weight[k] > weight[region]) region = k;
#endif
  region += FIRST;
#if PLACE || CUTS || LINES
  regionShaded = region;
#endif
#if CUTS && CUTS_BY_REGION
  if (isCut(L, p, region)) return vec4(0.0);
#endif
  float factor = uRegion[region].x;
  vec3 colour = vec3(0.0);
#if PAINTED
  float share = uShare[region].x;
  if (share < 1.0) colour = uCode[L].z * texture(uDiffuse, q).rgb;
  if (share > 0.0) {
    vec3 paint = texture(uPaint, onGrid(p, uGrid2[L].zw, uPaintSize)).rgb;
    colour = mix(colour, paint, share);
#if STROKES
    vec4 s = uStrokes[region];
    float pale = s.y < 0.0 ? max(paint.r, max(paint.g, paint.b)) : min(paint.r, min(paint.g, paint.b));
    factor *= exp(s.x + clamp(s.y * (s.z - pale), -s.w, s.w));
#endif
  }
#else
  colour = uCode[L].z * texture(uDiffuse, q).rgb;
#endif
#if MATCAPS
  if (uShare[region].y > 0.5) return vec4(matcapColour(l, p, uShare[region].y), factor);
#endif
#if LIT > 0
  vec3 how = uRegion[region].yzw;
  if (how.x == 0.0 || KIND == 0) return vec4(colour, factor);
  vec2 light;
#if (LIT & 1) != 0
  if (KIND == 1) light = harmonicLight(l, p);
#endif
#if (LIT & 2) != 0
  if (KIND == 2) {
#if WEIGHTS > 0
    vec4 reflects = vec4(0.0);
    float whole = 0.0;
    for (int k = 0; k < COUNT; k++) { reflects += weight[k] * uReflects[FIRST + k]; whole += weight[k]; }
    light = lampLight(l, p, reflects / whole);
#else
    light = lampLight(l, p, uReflects[region]);
#endif
  }
#endif
  colour = colour * max(1.0 + how.x * (how.y * light.x - 1.0), 0.0) + how.x * (light.y - how.z);
#endif
  return vec4(colour, factor);
}

vec4 uncut(int l, vec3 p) {
  vec4 found = unshadowed(l, p);
#if SHADOWS
  found.rgb *= 1.0 - uShadow * (1.0 - texture(uShadows, onGrid(p, uShadowsGrid[L], uShadowsSize)).r);
#endif
  return found;
}

// The same, cut open (svv/fields/scene/sections.py).
vec4 shaded(int l, vec3 p) {
  vec4 found = uncut(l, p);
#if CUTS && CUTS_BY_REGION
  if (found.a == 0.0) return found;
  vec3 face = p; // the place on the face that is nearest: samples lie more or less deep behind it
  float near = 0.0, reach = max(DEEP / uBox[L].w, DEEP * uMarch[L].x);
  for (int c = 0; c < CUTS; c++) {
    if (uCutRegions[c] != 0 && (uCutRegions[c] & (1 << regionShaded)) == 0) continue;
    float depth = cutDepth(l, c, p), own = clamp(2.0 + 2.0 * depth / reach, 0.0, 1.0);
    if (own <= near) continue;
    vec2 aside = vec2(1e-3, 0.0);
    vec3 slope = vec3(cutDepth(l, c, p + aside.xyy), cutDepth(l, c, p + aside.yxy), cutDepth(l, c, p + aside.yyx)) - depth;
    near = own, face = p - depth * slope / max(length(slope), 1e-9);
  }
  faceShaded = near;
  vec4 section = uSection[regionShaded];
  if (section.a > 0.5 && near > 0.0) {
    vec3 wash = section.rgb;
    if (section.a > 1.5) {
      int k = regionShaded % 4;
      vec3 across = k == 0 ? vec3(1.0, 2.0, 3.0) : k == 1 ? vec3(3.0, -1.0, 2.0) : k == 2 ? vec3(2.0, 3.0, -1.0) : vec3(-1.0, 3.0, 2.0);
      float away = HATCHES * dot(face, normalize(across));
      away = abs(away - floor(away + 0.5));
      wash = mix(wash, HATCH_INK * wash, clamp((0.5 * (HATCH_WIDTH + HATCH_SOFTNESS) - away) / HATCH_SOFTNESS, 0.0, 1.0));
    }
    found.rgb = mix(found.rgb, wash, near);
  }
#endif
  return found;
}

// Numbers of the first and the last sample on a piece of a ray within a box: whole paces apart, the first half a pace behind its beginning.
ivec2 samplesOn(vec2 piece, vec2 within, float pace) {
  float last = floor((within.y - piece.x) / pace - 0.5);
  if (piece.y < within.y) last = min(last, ceil((piece.y - piece.x) / pace) - 1.0);
  return ivec2(max(0.0, ceil((within.x - piece.x) / pace - 0.5)), last);
}

void main() {
  vec2 at = (gl_FragCoord.xy * uPixel - uLens.yz) / uLens.x;
  bool parallel = uLens.w > 0.5;
  vec3 d = normalize(uAxes * vec3(parallel ? vec2(0.0) : at, -1.0));
  d = mix(d, vec3(1e-9), lessThan(abs(d), vec3(1e-9)));
#if (LIT & 1) != 0
  prepareHarmonics(d);
#endif
#if (LIT & 2) != 0
  prepareLamp(d);
#endif
#if MATCAPS
  prepareMatcaps(d);
#endif
  // Of each layer: its ray's origin in box coordinates; its next and last sample; the optical depth that waits to be shaded, where, at
  // which distance in the first layer's box units, and the factor on that shaded before.
  vec3 origins[LAYERS], places[LAYERS], tops[LAYERS]; // of each layer, also the heaviest step, for rays that have no sample
  int nexts[LAYERS], lasts[LAYERS];
  float waitings[LAYERS], times[LAYERS], factors[LAYERS], mosts[LAYERS], topTimes[LAYERS];
#if CUTS
  vec2 pieces[LAYERS], withins[LAYERS]; // where the piece of the ray begins and ends that is being sampled, and the ray in the box
#endif
  for (int l = 0; l < LAYERS; l++) {
    vec3 o = uPosition[l].xyz + uAxes * vec3(parallel ? at / uPosition[l].w : vec2(0.0), 0.0);
    vec3 a = -o / d, b = (uBox[l].xyz - o) / d, low = min(a, b), high = max(a, b);
    float near = max(max(low.x, low.y), max(low.z, 0.0)), far = min(high.x, min(high.y, high.z)), pace = uMarch[l].x;
    bool met = near < far && uMarch[l].w > 0.5;
    vec2 within = met ? vec2(near, far) : vec2(0.0, -1.0), piece = vec2(0.0, BEYOND);
#if CUTS
    for (int c = 0; c < CUTS; c++) spans[l * CUTS + c] = spanOf(l, c, o, d);
    pieces[l] = piece = vec2(0.0), withins[l] = within;
#endif
    ivec2 some = samplesOn(piece, within, pace);
    nexts[l] = some.x, lasts[l] = some.y;
    origins[l] = o, waitings[l] = times[l] = mosts[l] = 0.0, factors[l] = -1.0;
  }
  vec3 ahead = step(0.0, d), sum = vec3(0.0);
  float front = 1.0;
  vec3 ends[LAYERS]; // colour of the last sample that was shaded, which what is left behind it has as well
#if DOUBT
  float doubt = 0.0, errors[LAYERS];
#endif
#if PLACE || LINES
  float shares[REGIONS], shownAt[LAYERS]; // weight of each region; distance of the last sample, and its region
  int regions[LAYERS];
  for (int k = 0; k < REGIONS; k++) shares[k] = 0.0;
#endif
#if LINES
  float away = 0.0, face = 0.0, facesOf[LAYERS]; // distance and part of faces of cuts, times alpha
#endif
#if PLACE
  float heaviest[REGIONS], farthest[REGIONS]; // of each region, its heaviest sample, and how far that is
  for (int k = 0; k < REGIONS; k++) heaviest[k] = farthest[k] = 0.0;
#endif
  for (;;) {
    int l = 0; // the layer that is to be shaded at the least distance; at first, none is to be shaded
    for (int k = 1; k < LAYERS; k++) if (times[k] < times[l]) l = k;
    if (times[L] == BEYOND) break;
    vec3 place = places[L];
    float waiting = waitings[L];
    if (waiting > 0.0) {
      vec4 found = shaded(l, place);
      float through = exp(-waiting * found.a), own = front * (1.0 - through);
      ends[L] = found.rgb;
      sum += own * found.rgb;
#if DOUBT
      errors[L] = texture(uDoubt, place.zyx * uDoubtSize).r;
      doubt += own * errors[L];
#endif
#if PLACE || LINES
      regions[L] = regionShaded, shownAt[L] = times[L];
      shares[regionShaded] += own;
#endif
#if LINES
      facesOf[L] = faceShaded;
      away += own * times[L], face += own * faceShaded;
#endif
#if PLACE
      if (own > heaviest[regionShaded]) heaviest[regionShaded] = own, farthest[regionShaded] = times[L];
#endif
      front *= through;
      factors[L] = found.a, waiting = waitings[L] = 0.0;
      if (front < uStop) break;
    }
    // On to its next sample that is to be shaded.
    vec3 o = origins[L], extent = uBox[L].xyz;
    vec2 grid = uGrid[L].xy, code = uCode[L].xy;
    float pace = uMarch[L].x, joined = uMarch[L].z, cells = uBox[L].w;
    ivec3 most = ivec3(uCells[L].xyz) - 1, first = ivec3(0, 0, int(uCells[L].w));
    int i = nexts[L], last = lasts[L];
    float begin = 0.0, t = 0.0;
    bool found = false;
#if CUTS
    vec2 piece = pieces[L], within = withins[L];
    begin = piece.x;
#endif
    while (!found) {
      if (i > last) {
#if CUTS
        if (piece.y < within.y) { // on to the next piece
          piece = pieceFrom(L, piece.y);
          begin = piece.x;
          if (begin < within.y) {
            ivec2 some = samplesOn(piece, within, pace);
            i = some.x, last = some.y;
          }
          continue;
        }
#endif
        break;
      }
      t = begin + (float(i) + 0.5) * pace;
#if CUTS
      // A sample across the end of a piece stands for what it covers of it, and is in the middle of that.
      float covered = min((piece.y - t) / pace + 0.5, 1.0);
      t -= 0.5 * (1.0 - covered) * pace;
#endif
      vec3 p = o + t * d;
      ivec3 cell = clamp(ivec3(p * cells), ivec3(0), most);
      float empty = float(texelFetch(uLeaps, cell.zyx + first, 0).r);
      if (empty > 0.0) {
        // On to the first sample behind the cube of empty cells around this one.
        vec3 wall = (vec3(cell) + mix(vec3(1.0 - empty), vec3(empty), ahead)) / cells;
        vec3 exits = (wall - o) / d;
        i = max(i + 1, int(ceil((min(exits.x, min(exits.y, exits.z)) - begin) / pace - 0.5)));
        continue;
      }
      i++;
      vec3 inside = clamp(p, vec3(0.0), extent);
      float value = texture(uExtinction, onGrid(inside, grid, uExtinctionSize)).r;
      float own = exp(min(code.x + code.y * value, CEILING)) * pace;
#if CUTS
      own *= covered;
#endif
      place = inside;
      if (own > mosts[L]) mosts[L] = own, tops[L] = inside, topTimes[L] = t * uMarch[L].y / pace;
      waiting = own + waiting;
      found = front * waiting >= joined && front * (1.0 - exp(-waiting)) >= joined;
    }
    nexts[L] = i, waitings[L] = waiting, places[L] = place;
#if CUTS
    pieces[L] = piece, lasts[L] = last;
#endif
    times[L] = found ? t * uMarch[L].y / pace : BEYOND;
  }
  // What is left behind the last sample of a layer is a part of it (svv/kernels/types.py, ended); if there is none, all of
  // it is one sample at the heaviest step (svv/core/rays/marching.py).
  for (int l = 0; l < LAYERS; l++) {
    if (waitings[l] <= 0.0) continue;
    if (factors[l] < 0.0) {
      vec4 found = shaded(l, tops[l]);
      factors[l] = found.a, ends[l] = found.rgb;
#if DOUBT
      errors[l] = texture(uDoubt, tops[l].zyx * uDoubtSize).r;
#endif
#if PLACE || LINES
      regions[l] = regionShaded, shownAt[l] = topTimes[l];
#endif
#if LINES
      facesOf[l] = faceShaded;
#endif
    }
    float through = exp(-waitings[l] * factors[l]), own = front * (1.0 - through);
    front *= through;
    sum += own * ends[l];
#if DOUBT
    doubt += own * errors[l];
#endif
#if PLACE || LINES
    shares[regions[l]] += own;
#endif
#if LINES
    away += own * shownAt[l], face += own * facesOf[l];
#endif
#if PLACE
    if (own > heaviest[regions[l]]) heaviest[regions[l]] = own, farthest[regions[l]] = shownAt[l];
#endif
  }
#if PLACE
  // The region that shows most, from 1; before it, in three bytes, the distance as a fraction of FARTHEST.
  int shown = 0;
  for (int k = 1; k < REGIONS; k++) if (shares[k] > shares[shown]) shown = k;
  float fraction = clamp(farthest[shown] / FARTHEST, 0.0, 1.0) * 16777215.0;
  float high = floor(fraction / 65536.0), middle = floor((fraction - 65536.0 * high) / 256.0);
  pixel = vec4(high, middle, floor(fraction - 65536.0 * high - 256.0 * middle), 1.0 - front > 1.0 / 512.0 ? float(shown + 1) : 0.0) / 255.0;
  return;
#endif
  float alpha = 1.0 - front;
#if DOUBT
  vec4 told = vec4(sum + front, sqrt(doubt));
  pixel = uvec4(65535.0 * clamp(told, 0.0, 1.0) + 0.5);
  pixel.a = alpha > 1.0 / 512.0 ? max(pixel.a, 1u) : 0u;
#else
  vec3 mean = alpha > 1.0 / 512.0 ? clamp(sum / alpha, 0.0, 1.0) * alpha : vec3(0.0);
  pixel = vec4(mean + uBackground * (alpha > 1.0 / 512.0 ? front : 1.0), 1.0);
#if LINES
  int largest = 0;
  for (int k = 1; k < REGIONS; k++) if (shares[k] > shares[largest]) largest = k;
  bool visible = alpha > 1.0 / 512.0;
  told = uvec4(floatBitsToUint(alpha), floatBitsToUint(uUnit * away / alpha), visible ? uint(largest + 1) : 0u, floatBitsToUint(face));
#endif
#endif
}
