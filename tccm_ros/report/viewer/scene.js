// Buffers from the page's data: one function for each kind of object in the scene.

const BOUNDARY = [30, 34, 40];
const WALL_HEIGHT = 0.9;
const SIGN_HALF_M = [0.1, 0.05];  // drawn half width and half height of a plate
const SIGN_LIFT_M = 0.02;
const GRID_STEP = 1;
const MAX_HORIZONTAL_HEIGHT = 2.0;  // horizontal planes above are ceilings: in the layer of the walls

async function unpackBlob(text) {
  const bytes = Uint8Array.from(atob(text.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Response(stream).arrayBuffer();
}

const TYPES = { f4: Float32Array, f8: Float64Array, i2: Int16Array, u2: Uint16Array };

class Arrays {
  constructor(buffer) { this.buffer = buffer; }

  // A reference is [type, byte offset, count].
  get([type, offset, count]) { return new TYPES[type](this.buffer, offset, count); }

  // Columns whose rows are near their neighbours are stored as differences, modulo 2^16.
  sum(reference) {
    const out = this.get(reference).slice();
    for (let i = 1; i < out.length; i++) out[i] += out[i - 1];
    return out;
  }
}

// What the pointer can find: every object gets a number, and cuboids get one each after those.
class Register {
  constructor() { this.entries = [null]; }

  add(entry) { return this.entries.push(entry) - 1; }
}

function addShape(arrays, shape, fill, outline, color, edge, number) {
  const v = arrays.get(shape.v);
  const point = (i) => [v[3 * i], v[3 * i + 1], v[3 * i + 2]];
  for (const i of arrays.get(shape.t)) fill.push(point(i), color, number);
  addRings(v, shape.rings, outline, edge, number);
}

function buildSurfaces(gl, arrays, scene, register) {
  const [floor, floorEdge, fill, edge] = [new Rows(3), new Rows(6), new Rows(3), new Rows(6)];
  for (const surface of scene.surfaces) {
    const number = register.add({ kind: 'surface', ...surface });
    const color = hexColor(surface.color);
    if (surface.floor) addShape(arrays, surface.shape, floor, floorEdge, color, [200, 205, 212], number);
    else addShape(arrays, surface.shape, fill, edge, color, BOUNDARY, number);
  }
  return { floor: floor.upload(gl), floorEdge: floorEdge.upload(gl), fill: fill.upload(gl),
    edge: edge.upload(gl) };
}

function addRings(v, rings, edge, color, number) {
  let first = 0;
  const point = (i) => [v[3 * i], v[3 * i + 1], v[3 * i + 2]];
  for (const size of rings) {
    for (let i = 0; i < size; i++) {
      edge.push([...point(first + i), ...point(first + ((i + 1) % size))], color, number);
    }
    first += size;
  }
}

function buildFree(gl, arrays, scene, register) {
  const edge = new Rows(6);
  for (const place of scene.free) {
    const number = register.add({ kind: 'free', ...place });
    addRings(arrays.get(place.v), place.rings, edge, [0, 130, 60], number);
  }
  return { edge: edge.upload(gl) };
}

// The edges of each compartment, and an arrow into it through its front.
function buildRacks(gl, scene, register) {
  const edge = new Rows(6);
  for (const space of scene.racks) {
    const number = register.add({ kind: 'compartment', ...space });
    for (const ends of space.edges) edge.push(ends.flat(), [170, 80, 0], number);
  }
  return { edge: edge.upload(gl) };
}

function buildWalls(gl, scene, register) {
  const [fill, edge] = [new Rows(3), new Rows(6)];
  const color = hexColor(scene.colors.wall);
  const [low, high] = [scene.ground, scene.ground + WALL_HEIGHT];
  for (const wall of scene.walls) {
    const number = register.add({ kind: 'wall', ...wall });
    const [a, b] = wall.ends;
    const [p, q, r, s] = [[...a, low], [...b, low], [...b, high], [...a, high]];
    for (const corner of [p, q, r, p, r, s]) fill.push(corner, color, number);
    for (const ends of [[p, q], [s, r], [p, s], [q, r]]) edge.push(ends.flat(), color, number);
  }
  return { fill: fill.upload(gl), edge: edge.upload(gl) };
}

// A plate in front of the wall for each door sign.
function buildSigns(gl, scene, register) {
  const [fill, edge] = [new Rows(3), new Rows(6)];
  const color = hexColor(scene.colors.sign);
  for (const sign of scene.signs) {
    const number = register.add({ kind: 'sign', ...sign });
    const [nx, ny] = sign.normal;
    const long = Math.hypot(nx, ny) || 1;
    const corner = ([a, b]) => [sign.at[0] + SIGN_LIFT_M * nx - a * ny / long,
      sign.at[1] + SIGN_LIFT_M * ny + a * nx / long, sign.at[2] + b];
    const [w, h] = SIGN_HALF_M;
    const [p, q, r, s] = [[-w, -h], [w, -h], [w, h], [-w, h]].map(corner);
    for (const point of [p, q, r, p, r, s]) fill.push(point, color, number);
    for (const ends of [[p, q], [q, r], [r, s], [s, p]]) edge.push(ends.flat(), BOUNDARY, number);
  }
  return { fill: fill.upload(gl), edge: edge.upload(gl) };
}

function buildObjects(gl, scene, register, onSurface) {
  const [fill, edge] = [new Rows(3), new Rows(6)];
  const color = hexColor(scene.colors.object);
  const lighter = color.map((v) => Math.min(v + 50, 255));
  for (const box of scene.objects) {
    if (scene.surfaceIds.includes(box.surface) !== onSurface) continue;
    const number = register.add({ kind: 'object', ...box });
    const low = box.corners.map((c) => [...c, box.low]);
    const high = box.corners.map((c) => [...c, box.high]);
    for (let i = 0; i < 4; i++) {
      const j = (i + 1) % 4;
      for (const p of [low[i], low[j], high[j], low[i], high[j], high[i]]) fill.push(p, color, number);
      for (const ends of [[low[i], low[j]], [high[i], high[j]], [low[i], high[i]]]) {
        edge.push(ends.flat(), BOUNDARY, number);
      }
    }
    for (const i of [0, 1, 2, 0, 2, 3]) fill.push(high[i], lighter, number);
  }
  return { fill: fill.upload(gl), edge: edge.upload(gl) };
}

function buildPath(gl, arrays, scene, register) {
  const [line, places] = [new Rows(6), new Rows(6)];
  const points = arrays.get(scene.path.points);
  const color = hexColor(scene.colors.path);
  const number = register.add({ kind: 'path', length: scene.path.length });
  for (let i = 0; i + 5 < points.length; i += 3) line.push(points.subarray(i, i + 6), color, number);
  for (const place of scene.places) {
    const [x, y] = place.at;
    const at = register.add({ kind: 'view', ...place });
    const post = [x, y, scene.ground, x, y, scene.ground + 0.1];
    places.push(post, hexColor(scene.colors.view), at);
  }
  return { line: line.upload(gl), places: places.upload(gl) };
}

// An arrow on the floor at the origin, heading along x.
function buildRobot(gl, scene) {
  const fill = new Rows(3);
  const z = 0.03;
  const corners = [[0.28, 0, z], [-0.2, 0.17, z], [-0.11, 0, z], [0.28, 0, z], [-0.11, 0, z],
    [-0.2, -0.17, z]];
  for (const corner of corners) fill.push(corner, hexColor(scene.colors.view));
  return { fill: fill.upload(gl) };
}

function buildGrid(gl, scene) {
  const edge = new Rows(6);
  const [[x0, y0], [x1, y1]] = scene.extent.map((p, i) => p.map(i ? Math.ceil : Math.floor));
  const z = scene.ground - 0.04;
  const step = GRID_STEP * Math.max(1, Math.ceil(Math.max(x1 - x0, y1 - y0) / 60));
  for (let x = x0; x <= x1; x += step) edge.push([x, y0, z, x, y1, z], [216, 220, 226]);
  for (let y = y0; y <= y1; y += step) edge.push([x0, y, z, x1, y, z], [216, 220, 226]);
  return { edge: edge.upload(gl) };
}

function buildCores(gl, arrays, cores) {
  const edge = new Rows(6);
  if (cores) {
    const columns = cores.columns.map((reference, i) => (i < 3 ? arrays.sum(reference) : arrays.get(reference)));
    const [x, y, z, u, v, w] = columns;
    for (let i = 0; i < x.length; i++) {
      edge.push([x[i] - u[i], y[i] - v[i], z[i] - w[i], x[i] + u[i], y[i] + v[i], z[i] + w[i]]
        .map((value) => value * cores.unit), [178, 34, 52]);
    }
  }
  return { edge: edge.upload(gl) };
}

// All cycles' cuboids in one buffer: what the map held after a cycle is one range of it.
function buildCuboids(gl, arrays, table, cycle) {
  const [ix, iy, bottom] = [table.ix, table.iy, table.bottom].map((r) => arrays.sum(r));
  const top = arrays.get(table.thickness).map((value, i) => value + bottom[i]);
  return { top, cycle, ...uploadCuboids(gl, { ix, iy, bottom, top, cycle }) };
}

function buildFinal(gl, arrays, final) {
  if (!final) return null;
  const set = buildCuboids(gl, arrays, final, arrays.get(final.cycle));
  return { ...set, points: arrays.get(final.points), frame: fromRows(final.frame) };
}

function buildHistory(gl, arrays, cycles) {
  if (!cycles) return null;
  const cycle = new Int16Array(cycles.offsets[cycles.offsets.length - 1]);
  cycles.stamps.forEach((_, i) => cycle.fill(i, cycles.offsets[i], cycles.offsets[i + 1]));
  return { ...buildCuboids(gl, arrays, cycles, cycle), frames: cycles.frames.map(fromRows) };
}

function buildPlanes(gl, arrays, scene, register, isHorizontal) {
  return scene.planes.map((cycle) => {
    const [fill, edge] = [new Rows(3), new Rows(6)];
    for (const plane of cycle.planes) {
      if ((plane.kind === 'horizontal' && plane.height < MAX_HORIZONTAL_HEIGHT) !== isHorizontal) continue;
      const number = register.add({ kind: 'plane', ...plane });
      const color = hexColor(scene.palette[plane.id % scene.palette.length]);
      addShape(arrays, plane.shape, fill, edge, color, color, number);
    }
    return { fill: fill.upload(gl), edge: edge.upload(gl) };
  });
}

function buildScene(gl, arrays, scene) {
  const register = new Register();
  const built = {
    surfaces: buildSurfaces(gl, arrays, scene, register),
    walls: buildWalls(gl, scene, register),
    signs: buildSigns(gl, scene, register),
    objects: buildObjects(gl, scene, register, true),
    free: buildFree(gl, arrays, scene, register),
    racks: buildRacks(gl, scene, register),
    floor_objects: buildObjects(gl, scene, register, false),
    path: buildPath(gl, arrays, scene, register),
    planes: buildPlanes(gl, arrays, scene, register, true),
    other_planes: buildPlanes(gl, arrays, scene, register, false),
    robot: buildRobot(gl, scene),
    grid: buildGrid(gl, scene),
    cores: buildCores(gl, arrays, scene.cores),
    final: buildFinal(gl, arrays, scene.final),
    history: buildHistory(gl, arrays, scene.cycles),
    entries: register.entries,
  };
  return built;
}
