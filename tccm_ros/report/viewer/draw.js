// Thin wrappers over WebGL2: programs, and the three kinds of buffers that they draw.

function makeProgram(gl, vertexText) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertexText], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    throw new Error(`shader: ${gl.getProgramInfoLog(program)}`);
  }
  const uniforms = {};
  const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
  for (let i = 0; i < count; i++) {
    const { name } = gl.getActiveUniform(program, i);
    uniforms[name] = gl.getUniformLocation(program, name);
  }
  return { program, uniforms, at: (name) => gl.getAttribLocation(program, name) };
}

function makeBuffer(gl, data) {
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
  return buffer;
}

// Collects vertices (or the two ends of lines), each row with a colour and a number.
class Rows {
  constructor(floats) {
    this.floats = floats;
    this.values = [];
    this.tags = [];
  }

  push(values, color, number = 0) {
    for (const value of values) this.values.push(value);
    const [r, g, b, a = 255] = color;
    this.tags.push((r | (g << 8) | (b << 16) | (a << 24)) >>> 0, number);
  }

  get count() { return this.tags.length / 2; }

  upload(gl) {
    return {
      count: this.count,
      values: makeBuffer(gl, new Float32Array(this.values)),
      tags: makeBuffer(gl, new Uint32Array(this.tags)),
    };
  }
}

function bindRows(gl, program, rows, names, perInstance) {
  gl.bindBuffer(gl.ARRAY_BUFFER, rows.values);
  names.forEach((name, i) => {
    attribute(gl, program.at(name), 3, gl.FLOAT, names.length * 12, i * 12, perInstance);
  });
  gl.bindBuffer(gl.ARRAY_BUFFER, rows.tags);
  attribute(gl, program.at('aColor'), 4, gl.UNSIGNED_BYTE, 8, 0, perInstance, true);
  const number = program.at('aNumber');
  gl.enableVertexAttribArray(number);
  gl.vertexAttribIPointer(number, 1, gl.UNSIGNED_INT, 8, 4);
  gl.vertexAttribDivisor(number, perInstance ? 1 : 0);
}

function attribute(gl, at, size, type, stride, offset, perInstance, scaled = false) {
  gl.enableVertexAttribArray(at);
  gl.vertexAttribPointer(at, size, type, scaled, stride, offset);
  gl.vertexAttribDivisor(at, perInstance ? 1 : 0);
}

const CUBOID_BYTES = 12;

// Interleaves columns of int16: cell x y, bottom, top, cycle, and one of padding.
function uploadCuboids(gl, columns) {
  const count = columns.ix.length;
  const rows = new Int16Array(count * 6);
  const order = [columns.ix, columns.iy, columns.bottom, columns.top, columns.cycle];
  order.forEach((column, c) => { for (let i = 0; i < count; i++) rows[i * 6 + c] = column[i]; });
  return { count, rows: makeBuffer(gl, rows) };
}

// Frees the buffers of a scene that is shown no more.
function freeBuffers(gl, built) {
  for (const [name, value] of Object.entries(built)) {
    if (value instanceof WebGLBuffer) gl.deleteBuffer(value);
    else if (value && typeof value === 'object' && !ArrayBuffer.isView(value) && name !== 'entries') freeBuffers(gl, value);
  }
}

class Painter {
  constructor(gl) {
    this.gl = gl;
    this.mesh = makeProgram(gl, MESH_VERTEX);
    this.line = makeProgram(gl, LINE_VERTEX);
    this.cuboid = makeProgram(gl, CUBOID_VERTEX);
    this.colors = gl.createTexture();
    this.makePickTarget();
  }

  // Two rows of 256 colours: by height, by age.
  setColors(bytes) {
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, this.colors);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 256, 2, 0, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  }

  // A target of one pixel: the view is shifted so that the pixel under the pointer falls on it.
  makePickTarget() {
    const gl = this.gl;
    this.pickTarget = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.pickTarget);
    const color = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, color);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, 1, 1);
    gl.framebufferRenderbuffer(
      gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, color);
    const depth = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, 1, 1);
    gl.framebufferRenderbuffer(
      gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  begin(view, pick) {
    const gl = this.gl;
    this.view = view;
    this.pick = Boolean(pick);
    gl.bindFramebuffer(gl.FRAMEBUFFER, pick ? this.pickTarget : null);
    gl.viewport(pick ? -pick[0] : 0, pick ? -pick[1] : 0, view.width, view.height);
    gl.clearColor(...(pick ? [0, 0, 0, 0] : [1, 1, 1, 1]));
    gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  // Returns the number that was drawn at the pixel.
  picked() {
    const bytes = new Uint8Array(4);
    this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.UNSIGNED_BYTE, bytes);
    this.gl.bindFramebuffer(this.gl.FRAMEBUFFER, null);
    return (bytes[0] | (bytes[1] << 8) | (bytes[2] << 16) | (bytes[3] << 24)) >>> 0;
  }

  use(program, frame, opacity) {
    const gl = this.gl;
    gl.useProgram(program.program);
    gl.uniformMatrix4fv(program.uniforms.uViewProjection, false, this.view.matrix);
    gl.uniformMatrix4fv(program.uniforms.uFrame, false, frame);
    gl.uniform1i(program.uniforms.uPick, this.pick ? 1 : 0);
    gl.uniform1f(program.uniforms.uOpacity, opacity);
    const blended = opacity < 1 && !this.pick;
    gl[blended ? 'enable' : 'disable'](gl.BLEND);
    gl.depthMask(!blended);
  }

  fill(rows, frame = IDENTITY, opacity = 1) {
    if (!rows.count) return;
    this.use(this.mesh, frame, opacity);
    bindRows(this.gl, this.mesh, rows, ['aPosition'], false);
    this.gl.drawArrays(this.gl.TRIANGLES, 0, rows.count);
  }

  lines(rows, width, frame = IDENTITY, opacity = 1) {
    if (!rows.count) return;
    const gl = this.gl;
    this.use(this.line, frame, opacity);
    gl.uniform2f(this.line.uniforms.uViewport, this.view.width, this.view.height);
    gl.uniform1f(this.line.uniforms.uWidth, width * this.view.ratio);
    gl.uniform1f(this.line.uniforms.uDepth, this.view.depth);
    bindRows(gl, this.line, rows, ['aStart', 'aEnd'], true);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, rows.count);
  }

  cuboids(set, first, count, look) {
    if (count <= 0) return;
    const gl = this.gl;
    const { uniforms } = this.cuboid;
    this.use(this.cuboid, look.frame, 1);
    gl.uniform3fv(uniforms.uEye, intoFrame(look.frame, this.view.eye));
    gl.uniform1f(uniforms.uCellSize, look.cellSize);
    gl.uniform1f(uniforms.uHeightUnit, look.heightUnit);
    gl.uniform1f(uniforms.uNow, look.now);
    gl.uniform1f(uniforms.uWindow, look.window);
    gl.uniform1i(uniforms.uByAge, look.byAge ? 1 : 0);
    gl.uniform2fv(uniforms.uHeightRange, look.heightRange);
    gl.uniform1f(uniforms.uCut, look.cut);
    gl.uniform1ui(uniforms.uFirstNumber, look.firstNumber + first);
    gl.bindTexture(gl.TEXTURE_2D, this.colors);
    gl.bindBuffer(gl.ARRAY_BUFFER, set.rows);
    const start = first * CUBOID_BYTES;
    attribute(gl, this.cuboid.at('aCell'), 2, gl.SHORT, CUBOID_BYTES, start, true);
    attribute(gl, this.cuboid.at('aSpan'), 2, gl.SHORT, CUBOID_BYTES, start + 4, true);
    attribute(gl, this.cuboid.at('aCycle'), 1, gl.SHORT, CUBOID_BYTES, start + 8, true);
    gl.drawArraysInstanced(gl.TRIANGLES, 0, 18, count);
  }
}
