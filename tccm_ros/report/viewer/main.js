// The page: layers, slider, pointer and drawing. Nothing is drawn unless something changed.

const LAYERS = ['surfaces', 'boundaries', 'labels', 'objects', 'free', 'racks', 'floor_objects', 'walls', 'signs', 'path', 'cuboids',
  'planes', 'other_planes', 'cores', 'floor'];
const HEIGHT_RANGE_M = [0, 2];
const LIFT_M = 0.015;
const PLAY_STEP_MS = 250;
const HOVER_DELAY_MS = 40;

// Colours by height (grey floor, then dark blue to yellow) and by age (pale old, dark new).
const FLOOR_SHARE = 0.03;
const FLOOR_COLOR = hexColor('#d3d7dc');
const HEIGHT_STOPS = ['#472c7a', '#3b528b', '#2a788e', '#22a884', '#7ad151', '#fde725'];
const AGE_STOPS = ['#e4e4e4', '#b9c3cf', '#7f9bb5', '#3f6f9c', '#0b3c6f'];

function gradient(stops) {
  const colors = stops.map(hexColor);
  return Array.from({ length: 256 }, (_, i) => {
    const place = (i / 255) * (colors.length - 1);
    const low = Math.min(Math.floor(place), colors.length - 2);
    return colors[low].map((v, c) => Math.round(v + (colors[low + 1][c] - v) * (place - low)));
  });
}

const COLORS = {
  height: gradient(HEIGHT_STOPS).map((color, i) => (i < FLOOR_SHARE * 256 ? FLOOR_COLOR : color)),
  age: gradient(AGE_STOPS),
};
const ENDS = { height: ['floor', '2 m'], age: ['oldest', 'newest'] };

const byId = (id) => document.getElementById(id);

class Report {
  constructor(scene, arrays) {
    this.canvas = byId('view');
    const gl = this.canvas.getContext('webgl2', { antialias: true, preserveDrawingBuffer: true });
    if (!gl) throw new Error('this browser has no WebGL 2');
    this.gl = gl;
    this.painter = new Painter(gl);
    this.painter.setColors(new Uint8Array(
      [COLORS.height, COLORS.age].flatMap((colors) => colors.flatMap((c) => [...c, 255]))));
    this.livePose = null;  // (x, y, yaw), set by the live page alone
    this.load(scene, arrays);
    this.layers = Object.fromEntries(LAYERS.map((name) => [name, Boolean(byId(`layer-${name}`)?.checked)]));
    this.frames = 0;
    this.camera = new OrbitCamera(this.canvas, scene.extent, scene.ground, () => this.change());
    this.listen();
    if (byId('cut')) this.listenToCuboids();
    if (byId('cycle')) this.listenToTime();
    this.change();
  }

  // Shows another scene in place of the present one; the camera stays where it is.
  load(scene, arrays) {
    if (this.built) freeBuffers(this.gl, this.built);
    this.scene = scene;
    startStamp = scene.start;
    this.built = buildScene(this.gl, arrays, scene);
    this.stamps = arrays.get(scene.path.stamps);
    this.poses = arrays.get(scene.path.poses);
    this.cycleCount = scene.planes.length || (scene.cycles ? scene.cycles.stamps.length : 0);
    this.cycle = this.cycleCount;
    byId('labels').replaceChildren();
    this.labels = new Labels(byId('labels'), scene);
    if (this.camera) this.camera.setExtent(scene.extent, scene.ground);
  }

  change() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.draw(); });
  }

  listen() {
    for (const name of LAYERS) {
      byId(`layer-${name}`)?.addEventListener('change', (e) => this.setLayer(name, e.target.checked));
    }
    byId('home').addEventListener('click', () => this.camera.set(this.camera.home));
    byId('above').addEventListener('click', () => this.camera.set(this.camera.above));
    this.canvas.addEventListener('pointermove', (event) => this.hoverSoon(event));
    this.canvas.addEventListener('pointerleave', () => this.hideHover());
    new ResizeObserver(() => this.change()).observe(this.canvas);
  }

  // The controls of cuboids, which a page may be without.
  listenToCuboids() {
    byId('color-by').addEventListener('change', () => this.showKey());
    byId('cut').addEventListener('input', () => this.showCut());
    this.showKey();
    this.showCut();
  }

  // The controls of tilt cycles, likewise.
  listenToTime() {
    byId('cycle').addEventListener('input', (e) => { this.stop(); this.setCycle(Number(e.target.value)); });
    byId('play').addEventListener('click', () => (this.playing ? this.stop() : this.play()));
    this.setCycle(this.cycle);
  }

  showCut() {
    const height = this.cutHeight();
    byId('cut-text').textContent = height < 1e6 ? `up to ${height.toFixed(1)} m` : 'all';
    this.change();
  }

  showKey() {
    const by = byId('color-by').value;
    const shown = COLORS[by].map((c, i) => `rgb(${c}) ${(i / 2.55).toFixed(1)}%`);
    byId('key').style.background = `linear-gradient(90deg, ${shown})`;
    [byId('key-low').textContent, byId('key-high').textContent] = ENDS[by];
    this.change();
  }

  setLayer(name, on) {
    this.layers[name] = on;
    byId(`layer-${name}`).checked = on;
    this.change();
  }

  // Cycle 0 .. count - 1, or count for the final map.
  setCycle(cycle) {
    this.cycle = Math.min(Math.max(cycle, 0), this.cycleCount);
    const slider = byId('cycle');
    slider.max = String(this.cycleCount);
    slider.value = String(this.cycle);
    const now = this.cycleNow();
    byId('cycle-text').textContent = now === null ? 'final map'
      : `after cycle ${now.cycle} (${this.cycle + 1} of ${this.cycleCount}), ${since(now.stamp)}`;
    slider.setAttribute('aria-valuetext', byId('cycle-text').textContent);
    this.change();
  }

  // The cycle on the slider, or null at its end.
  cycleNow() {
    const { planes, cycles } = this.scene;
    if (this.cycle >= this.cycleCount) return null;
    if (planes.length) return { cycle: planes[this.cycle].cycle, stamp: planes[this.cycle].stamp };
    return { cycle: cycles.numbers[this.cycle], stamp: cycles.stamps[this.cycle] };
  }

  play() {
    if (this.cycle >= this.cycleCount) this.setCycle(0);
    byId('play').textContent = '❚❚';
    this.playing = setInterval(() => {
      this.setCycle(this.cycle + 1);
      if (this.cycle >= this.cycleCount) this.stop();
    }, PLAY_STEP_MS);
  }

  stop() {
    clearInterval(this.playing);
    this.playing = null;
    byId('play').textContent = '▶';
  }

  // Cuboids that begin above this height over the floor are left out; the slider's end shows all.
  cutHeight() {
    const { value, max } = byId('cut');
    return value === max ? 1e6 : Number(value);
  }

  // Which range of which set of cuboids shows, and how; null when there are none.
  cuboidLook() {
    const { scene, built } = this;
    if (!built.final && !built.history) return null;
    const byAge = byId('color-by').value === 'age';
    const look = (frame) => ({ frame, byAge, firstNumber: built.entries.length,
      cut: this.cutHeight() + scene.ground - frame[14],
      heightRange: HEIGHT_RANGE_M.map((v) => v + scene.ground - frame[14]) });
    if (this.cycleNow() === null) {
      const set = built.final;
      if (!set) return null;
      return { set, first: 0, count: set.count, ...look(set.frame), cellSize: scene.final.cell,
        heightUnit: scene.final.unit, now: scene.final.newest, window: scene.final.window };
    }
    const set = built.history;
    if (!set) return null;
    const { offsets, window, cell, numbers } = scene.cycles;
    const at = numbers.indexOf(this.cycleNow().cycle);
    if (at < 0) return null;
    const first = offsets[Math.max(at + 1 - window, 0)];
    return { set, first, count: offsets[at + 1] - first, ...look(set.frames[at]), cellSize: cell,
      heightUnit: 0.01, now: at, window };
  }

  // Where the odometry frame was at the cycle on the slider.
  planeFrame() {
    const { scene, built } = this;
    if (!built.history || scene.planes[this.cycle].in_map) return IDENTITY;
    const at = scene.cycles.numbers.indexOf(scene.planes[this.cycle].cycle);
    return at < 0 ? IDENTITY : built.history.frames[at];
  }

  robotFrame() {
    if (this.livePose) return this.frameOf(this.livePose);
    const now = this.cycleNow();
    if (!now || !this.stamps.length) return null;
    let at = 0;
    for (let i = 0; i < this.stamps.length; i++) {
      if (Math.abs(this.stamps[i] - now.stamp) < Math.abs(this.stamps[at] - now.stamp)) at = i;
    }
    return this.frameOf(this.poses.subarray(3 * at, 3 * at + 3));
  }

  frameOf([x, y, yaw]) {
    const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
    return new Float32Array([c, s, 0, 0, -s, c, 0, 0, 0, 0, 1, 0, x, y, this.scene.ground, 1]);
  }

  paint(view, pick) {
    const { painter, layers, built, gl } = this;
    painter.begin(view, pick);
    const clearPickDepth = () => { if (pick) { gl.depthMask(true); gl.clear(gl.DEPTH_BUFFER_BIT); } };
    if (!pick) painter.lines(built.grid.edge, 1);
    if (layers.floor) {
      painter.fill(built.surfaces.floor);
      painter.lines(built.surfaces.floorEdge, 1);
    }
    clearPickDepth();
    if (pick && layers.walls) painter.fill(built.walls.fill);
    clearPickDepth();
    this.paintContents();
    if (!pick && layers.walls) painter.fill(built.walls.fill, IDENTITY, 0.2);
  }

  paintContents() {
    const { painter, layers, built } = this;
    const cuboids = layers.cuboids ? this.cuboidLook() : null;
    if (cuboids) painter.cuboids(cuboids.set, cuboids.first, cuboids.count, cuboids);
    for (const name of ['objects', 'floor_objects']) {
      if (!layers[name]) continue;
      painter.fill(built[name].fill);
      painter.lines(built[name].edge, 1);
    }
    // Cuboids reach a little over the plane through their points: objects on it are lifted.
    const lifted = IDENTITY.slice();
    if (cuboids) lifted[14] = LIFT_M;
    if (layers.surfaces) painter.fill(built.surfaces.fill, lifted, 0.86);
    if (layers.boundaries) painter.lines(built.surfaces.edge, 2, lifted);
    if (layers.racks) painter.lines(built.racks.edge, 2, lifted);
    if (layers.free) painter.lines(built.free.edge, 3, multiply(lifted, lifted));
    for (const name of ['planes', 'other_planes']) {
      if (!layers[name] || !this.cycleNow() || !built[name].length) continue;
      const frame = multiply(lifted, multiply(lifted, this.planeFrame()));
      painter.fill(built[name][this.cycle].fill, frame, 0.5);
      painter.lines(built[name][this.cycle].edge, 3, frame);
    }
    if (layers.cores && built.final && !this.cycleNow()) painter.lines(built.cores.edge, 1.5, built.final.frame);
    if (layers.signs) {
      painter.fill(built.signs.fill);
      painter.lines(built.signs.edge, 2);
    }
    if (layers.path) this.paintPath();
    if (layers.walls) painter.lines(built.walls.edge, 2);
  }

  paintPath() {
    const { painter, built } = this;
    painter.lines(built.path.line, 2);
    painter.lines(built.path.places, 6);
    const robot = this.robotFrame();
    if (robot) painter.fill(built.robot.fill, robot);
  }

  view() {
    const { canvas } = this;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((v) => Math.max(Math.round(v * ratio), 1));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    return this.camera.view(width, height, ratio);
  }

  draw() {
    const view = this.view();
    this.paint(view, null);
    this.labels.place(view, { surface: this.layers.labels, sign: this.layers.signs, mark: this.layers.labels });
    this.frames += 1;
  }

  // What is drawn at a place of the canvas, in CSS pixels from its upper left; null for nothing.
  pick(x, y) {
    const view = this.view();
    this.paint(view, [Math.floor(x * view.ratio), Math.floor(view.height - 1 - y * view.ratio)]);
    const number = this.painter.picked();
    const { entries } = this.built;
    return number < entries.length ? entries[number] : this.cuboidEntry(number - entries.length);
  }

  // The point (x, y) at height z in map that is shown at a place of the canvas, in CSS pixels.
  pointAt(x, y, z) {
    const { matrix, width, height, ratio } = this.view();
    return onPlane(matrix, [2 * x * ratio / width - 1, 1 - 2 * y * ratio / height], z);
  }

  cuboidEntry(index) {
    const look = this.cuboidLook();
    if (!look || index >= look.set.count) return null;
    const cycle = look.set.cycle[index];
    return { kind: 'cuboid',
      top: look.set.top[index] * look.heightUnit + look.frame[14] - this.scene.ground,
      cycle: look.set.points ? cycle : this.scene.cycles.numbers[cycle],
      points: look.set.points ? look.set.points[index] : null };
  }

  hoverSoon(event) {
    clearTimeout(this.hoverTimer);
    if (this.camera.dragging) { this.hideHover(); return; }
    const { left, top } = this.canvas.getBoundingClientRect();
    const [x, y] = [event.clientX - left, event.clientY - top];
    this.hoverTimer = setTimeout(() => showHover(byId('hover'), this.pick(x, y), x, y), HOVER_DELAY_MS);
  }

  hideHover() {
    clearTimeout(this.hoverTimer);
    byId('hover').hidden = true;
  }
}
