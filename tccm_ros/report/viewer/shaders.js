// Three kinds of objects are drawn: filled meshes, lines of some pixels' width, and cuboids.
// Each is drawn with its colour, or, to find what lies under the pointer, with its number.

const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
in vec4 vColor;
in vec2 vEdge;
flat in uint vNumber;
uniform bool uPick;
uniform float uOpacity;
out vec4 outColor;
void main() {
  if (uPick) {
    outColor = vec4(uvec4(vNumber, vNumber >> 8, vNumber >> 16, vNumber >> 24) & 255u) / 255.0;
    return;
  }
  // Edges of cuboids: one pixel darker, fading out where cuboids are smaller than a few pixels.
  vec2 width = fwidth(vEdge) + 1e-6;
  vec2 away = min(vEdge, 1.0 - vEdge) / width;
  float line = (1.0 - smoothstep(0.6, 1.4, min(away.x, away.y)))
      * (1.0 - smoothstep(0.10, 0.35, max(width.x, width.y)));
  outColor = vec4(vColor.rgb * (1.0 - 0.32 * line), vColor.a * uOpacity);
}`;

const MESH_VERTEX = `#version 300 es
in vec3 aPosition;
in vec4 aColor;
in uint aNumber;
uniform mat4 uViewProjection;
uniform mat4 uFrame;
out vec4 vColor;
out vec2 vEdge;
flat out uint vNumber;
void main() {
  gl_Position = uViewProjection * uFrame * vec4(aPosition, 1.0);
  vColor = aColor;
  vEdge = vec2(0.5);
  vNumber = aNumber;
}`;

const LINE_VERTEX = `#version 300 es
in vec3 aStart;
in vec3 aEnd;
in vec4 aColor;
in uint aNumber;
uniform mat4 uViewProjection;
uniform mat4 uFrame;
uniform vec2 uViewport;
uniform float uWidth;
uniform float uDepth;
out vec4 vColor;
out vec2 vEdge;
flat out uint vNumber;
const float NEAR = 1e-3;
const float NEARER = 1.5e-3;  // lines on a surface are drawn nearer by this fraction of their distance
void main() {
  vec4 a = uViewProjection * uFrame * vec4(aStart, 1.0);
  vec4 b = uViewProjection * uFrame * vec4(aEnd, 1.0);
  if (a.w < NEAR && b.w >= NEAR) a = mix(b, a, (b.w - NEAR) / (b.w - a.w));
  if (b.w < NEAR && a.w >= NEAR) b = mix(a, b, (a.w - NEAR) / (a.w - b.w));
  vec2 along = (b.xy / b.w - a.xy / a.w) * uViewport;
  along = length(along) > 1e-4 ? normalize(along) : vec2(1.0, 0.0);
  bool atEnd = (gl_VertexID & 1) == 1;
  float side = (gl_VertexID & 2) == 2 ? 1.0 : -1.0;
  vec4 p = atEnd ? b : a;
  vec2 shift = (vec2(-along.y, along.x) * side + along * (atEnd ? 0.5 : -0.5)) * uWidth;
  p.xy += shift / uViewport * p.w;
  p.z += NEARER * uDepth;
  gl_Position = p;
  vColor = aColor;
  vEdge = vec2(0.5);
  vNumber = aNumber;
}`;

// Of a box only the three faces towards the eye can be seen: 18 vertices instead of 36.
const CUBOID_VERTEX = `#version 300 es
in vec2 aCell;
in vec2 aSpan;
in float aCycle;
uniform mat4 uViewProjection;
uniform mat4 uFrame;
uniform vec3 uEye;
uniform float uCellSize;
uniform float uHeightUnit;
uniform float uNow;
uniform float uWindow;
uniform bool uByAge;
uniform vec2 uHeightRange;
uniform float uCut;
uniform uint uFirstNumber;
uniform sampler2D uColors;
out vec4 vColor;
out vec2 vEdge;
flat out uint vNumber;
const vec2 CORNERS[6] = vec2[6](
  vec2(0, 0), vec2(1, 0), vec2(1, 1), vec2(0, 0), vec2(1, 1), vec2(0, 1));
void main() {
  float age = max(uNow - aCycle, 0.0);
  // Where cuboids coincide the newer is visible: older ones are drawn a little smaller.
  float inset = min(0.012 * age, 0.2) * uCellSize;
  vec3 low = vec3(aCell * uCellSize, aSpan.x * uHeightUnit) + inset;
  float top = min(aSpan.y * uHeightUnit, uCut);
  vec3 high = vec3((aCell + 1.0) * uCellSize, top) - inset;
  int axis = gl_VertexID / 6;
  vec2 corner = CORNERS[gl_VertexID % 6];
  vec3 side = step(0.5 * (low + high), uEye);
  vec3 fraction = axis == 0 ? vec3(side.x, corner) : axis == 1 ? vec3(corner.x, side.y, corner.y)
      : vec3(corner, side.z);
  gl_Position = uViewProjection * uFrame * vec4(mix(low, high, fraction), 1.0);
  if (aSpan.x * uHeightUnit > uCut) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  float value = uByAge ? 1.0 - age / max(uWindow - 1.0, 1.0)
      : (top - uHeightRange.x) / (uHeightRange.y - uHeightRange.x);
  vec2 at = vec2(clamp(value, 0.002, 0.998), uByAge ? 0.75 : 0.25);
  float light = axis == 2 ? 1.0 : axis == 0 ? 0.84 : 0.72;
  vColor = vec4(texture(uColors, at).rgb * light, 1.0);
  vEdge = corner;
  vNumber = uFirstNumber + uint(gl_InstanceID);
}`;
