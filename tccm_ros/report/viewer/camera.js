// An orbit camera: drag orbits, right drag or Shift moves, the wheel or a pinch zooms.

const FIELD_OF_VIEW = 0.6;
const STEEPEST = Math.PI / 2 - 0.002;

class OrbitCamera {
  constructor(canvas, extent, ground, changed) {
    this.canvas = canvas;
    this.changed = changed;
    this.touched = false;
    this.pointers = new Map();
    this.setExtent(extent, ground);
    this.set(this.home);
    this.listen();
  }

  // Where the whole map is; the camera moves there by `set`.
  setExtent(extent, ground) {
    const [[x0, y0], [x1, y1]] = extent;
    this.size = Math.max(x1 - x0, y1 - y0, 1);
    const target = [(x0 + x1) / 2, (y0 + y1) / 2, ground + 0.3];
    const wide = x1 - x0 >= y1 - y0;
    this.corners = [x0, x1].flatMap((x) => [y0, y1].flatMap((y) => [0, 0.9].map((h) => [x, y, ground + h])));
    this.home = { target, azimuth: wide ? -1.15 : 0.42, elevation: 0.86 };
    this.above = { target, azimuth: -Math.PI / 2, elevation: STEEPEST };
  }

  set(place) {
    Object.assign(this, place, { target: [...place.target] });
    this.fit();
    this.changed();
  }

  // The whole map in the middle of the picture, from the smallest distance that shows all of it.
  fit() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const project = () => {
      const { matrix } = this.view(width || 1, height || 1, 1);
      return this.corners.map((p) => toClip(matrix, p)).map(([x, y, , w]) => (w > 0 ? [x / w, y / w] : [9, 9]));
    };
    const middle = (values) => (Math.min(...values) + Math.max(...values)) / 2;
    for (let round = 0; round < 4; round++) {
      let [near, far] = [0.3, 12 * this.size];
      for (let i = 0; i < 20; i++) {
        this.distance = (near + far) / 2;
        const inside = project().every((p) => Math.max(Math.abs(p[0]), Math.abs(p[1])) < 0.95);
        if (inside) far = this.distance; else near = this.distance;
      }
      this.distance = far;
      const seen = project();
      this.move(-middle(seen.map((p) => p[0])) * width / 2, middle(seen.map((p) => p[1])) * height / 2);
    }
  }

  eye() {
    const { target, azimuth, elevation, distance } = this;
    const flat = distance * Math.cos(elevation);
    return [target[0] + flat * Math.cos(azimuth), target[1] + flat * Math.sin(azimuth),
      target[2] + distance * Math.sin(elevation)];
  }

  view(width, height, ratio) {
    const eye = this.eye();
    const near = Math.max(this.distance * 0.01, 0.01);
    const lens = perspective(FIELD_OF_VIEW, width / height, near, this.distance + 4 * this.size);
    const pose = lookAt(eye, this.target, [0, 0, 1]);
    return { eye, width, height, ratio, depth: lens[14], matrix: multiply(lens, pose) };
  }

  orbit(dx, dy) {
    this.azimuth -= dx * 0.006;
    this.elevation = Math.min(Math.max(this.elevation + dy * 0.006, -0.2), STEEPEST);
    this.changed();
  }

  move(dx, dy) {
    const scale = (2 * this.distance * Math.tan(FIELD_OF_VIEW / 2)) / this.canvas.clientHeight;
    const [c, s] = [Math.cos(this.azimuth), Math.sin(this.azimuth)];
    this.target[0] += (s * dx - c * dy) * scale;
    this.target[1] += (-c * dx - s * dy) * scale;
    this.changed();
  }

  zoom(factor) {
    this.distance = Math.min(Math.max(this.distance * factor, 0.3), 12 * this.size);
    this.changed();
  }

  listen() {
    const { canvas, pointers } = this;
    canvas.addEventListener('pointerdown', (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.touched = true;
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    const release = (event) => pointers.delete(event.pointerId);
    canvas.addEventListener('pointerup', release);
    canvas.addEventListener('pointercancel', release);
    canvas.addEventListener('pointermove', (event) => this.drag(event));
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      this.touched = true;
      this.zoom(Math.exp(Math.sign(event.deltaY) * Math.min(Math.abs(event.deltaY), 60) * 0.002));
    }, { passive: false });
  }

  drag(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    if (this.pointers.size === 2) {
      const [, other] = [...this.pointers].find(([id]) => id !== event.pointerId);
      const distance = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) + 1;
      this.zoom(distance(before) / distance(now));
      this.move(dx / 2, dy / 2);
    } else if (event.buttons & 2 || event.shiftKey) {
      this.move(dx, dy);
    } else {
      this.orbit(dx, dy);
    }
    this.pointers.set(event.pointerId, now);
  }

  get dragging() { return this.pointers.size > 0; }
}
