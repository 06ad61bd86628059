// Column-major 4x4 matrices, as WebGL takes them, and 3-vectors as plain arrays.

const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const normalize = (a) => { const n = Math.hypot(...a) || 1; return a.map((v) => v / n); };

const IDENTITY = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);

function multiply(a, b) {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c++) {
    for (let r = 0; r < 4; r++) {
      let sum = 0;
      for (let k = 0; k < 4; k++) sum += a[k * 4 + r] * b[c * 4 + k];
      out[c * 4 + r] = sum;
    }
  }
  return out;
}

function perspective(fovY, aspect, near, far) {
  const f = 1 / Math.tan(fovY / 2);
  const out = new Float32Array(16);
  out[0] = f / aspect;
  out[5] = f;
  out[10] = (far + near) / (near - far);
  out[11] = -1;
  out[14] = (2 * far * near) / (near - far);
  return out;
}

function lookAt(eye, target, up) {
  const back = normalize(subtract(eye, target));
  const right = normalize(cross(up, back));
  const top = cross(back, right);
  return new Float32Array([
    right[0], top[0], back[0], 0, right[1], top[1], back[1], 0, right[2], top[2], back[2], 0,
    -dot(right, eye), -dot(top, eye), -dot(back, eye), 1]);
}

// Rows of a rigid T_a_b as the files have it -> column-major.
const fromRows = (rows) => new Float32Array(16).map((_, i) => rows[(i % 4) * 4 + (i >> 2)]);

// Coordinates in b of a point in a, for a rigid column-major T_a_b.
function intoFrame(T, p) {
  const d = subtract(p, [T[12], T[13], T[14]]);
  return [0, 4, 8].map((c) => d[0] * T[c] + d[1] * T[c + 1] + d[2] * T[c + 2]);
}

// Clip coordinates (x, y, z, w) of a point.
function toClip(m, p) {
  return [0, 1, 2, 3].map((r) => m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r]);
}

// The point (x, y) of the horizontal plane at z that a projection shows at (u, v), -1 to 1 each.
function onPlane(m, [u, v], z) {
  const row = (r, at) => [0, 4, 8, 12].map((c) => m[c + r] - at * m[c + 3]);
  const [a, b] = [row(0, u), row(1, v)];
  const [p, q] = [a, b].map((r) => -(r[2] * z + r[3]));
  const det = a[0] * b[1] - a[1] * b[0];
  return [(p * b[1] - a[1] * q) / det, (a[0] * q - p * b[0]) / det];
}

const hexColor = (text) => [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16));
