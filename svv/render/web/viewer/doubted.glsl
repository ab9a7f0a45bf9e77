#version 300 es
// Expected errors as a picture (svv/fields/scene/doubt.py): those along the rays, and what edges add, in the colours of
// svv/io/pictures/output.py. The march has left colours over white and, in alpha, square roots of errors; 0 is nothing.
precision highp float;
precision highp usampler2D;

uniform usampler2D uMarched;
uniform vec3 uBackground;
uniform vec3 uHeat[4];   // from no error to the darkest
uniform float uMost;     // error of the largest level
uniform float uEdge;     // what the difference of neighbours counts for
uniform float uDarkest;  // error from which on it is darkest

out vec4 pixel;

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy), last = textureSize(uMarched, 0) - 1;
  uvec4 own = texelFetch(uMarched, at, 0);
  if (own.a == 0u) {
    pixel = vec4(uBackground, 1.0);
    return;
  }
  uvec4 right = texelFetch(uMarched, ivec2(min(at.x + 1, last.x), at.y), 0), below = texelFetch(uMarched, ivec2(at.x, max(at.y - 1, 0)), 0);
  vec3 change = abs(vec3(right.rgb) - vec3(own.rgb)) + abs(vec3(below.rgb) - vec3(own.rgb));
  float level = float(own.a) / 65535.0, error = level * level * uMost + uEdge * dot(change, vec3(1.0 / 3.0)) / 65535.0;
  float shade = 3.0 * clamp(clamp(error, 0.0, 1.0) / uDarkest, 0.0, 1.0);
  int k = int(min(shade, 2.0));
  pixel = vec4(mix(uHeat[k], uHeat[k + 1], shade - float(k)), 1.0);
}
