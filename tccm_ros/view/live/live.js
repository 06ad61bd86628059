// The live page: entities come as server-sent events; the report's viewer draws them.

const RECONNECT_MS = 1000;
const DRAG_PX = 4;
const LABELS = ['table', 'counter', 'shelf', 'seat', 'bed', 'ledge', 'step', 'other'];
const EVENTS_SHOWN = 100;

// Numbers come as plain lists here, not as references into packed arrays.
const PLAIN = { get: (values) => Float32Array.from(values), sum: (values) => values };

class Live {
  constructor() {
    this.entities = new Map();
    this.events = [];
    this.pose = null;
    this.status = {};
    this.picked = null;  // id of a surface
    this.spot = null;  // (x, y, z) that was clicked on it
    this.found = null;  // (x, y, z) of a placement
    this.token = location.hash.slice(1);
    history.replaceState(null, '', location.pathname + location.hash);
    for (const label of LABELS) byId('label').add(new Option(label, label));
    byId('label').add(new Option('as the rules say', ''));
    byId('rename').addEventListener('submit', (e) => this.submit(e, () => this.rename()));
    byId('placement').addEventListener('submit', (e) => this.submit(e, () => this.findPlacements()));
    byId('naming').addEventListener('submit', (e) => this.submit(e, () => this.nameSpot()));
    byId('save').addEventListener('submit', (e) => this.submit(e, () => this.save()));
    this.connect();
  }

  connect() {
    const source = new EventSource('events');
    source.onmessage = (message) => this.take(JSON.parse(message.data), source);
    source.onerror = () => {
      source.close();
      const name = this.status.is_replay ? 'the replay' : 'the node';
      this.say(`${name} has ended, or cannot be reached; trying again`, true);
      setTimeout(() => this.connect(), RECONNECT_MS);
    };
  }

  say(text, isLost) {
    byId('headline').textContent = text;
    byId('headline').classList.toggle('lost', isLost);
  }

  take(delta, source) {
    if (delta.ended) {
      source.onerror();
      return;
    }
    if (delta.first) {
      this.entities.clear();
      this.events = [];
    }
    for (const name of delta.gone || []) this.entities.delete(name);
    for (const [name, value] of Object.entries(delta.set || {})) this.entities.set(name, value);
    if (delta.pose !== undefined) this.pose = delta.pose;
    if (delta.status) this.status = delta.status;
    if (delta.events) this.events = [...this.events, ...delta.events].slice(-EVENTS_SHOWN);
    if (delta.first || delta.gone || delta.set) this.rebuild();
    if (this.report) {
      this.report.livePose = this.pose;
      this.report.change();
    }
    if (delta.first || delta.status || delta.set || delta.gone) this.showStatus();
    if (delta.first || delta.events) this.showEvents();
  }

  ofKind(kind) {
    return [...this.entities].filter(([name]) => name.startsWith(`${kind}/`)).map(([, value]) => value);
  }

  scene() {
    const world = this.entities.get('world');
    const surfaces = this.ofKind('surface').sort((a, b) => a.height - b.height || a.id - b.id);
    const path = this.entities.get('path') || { length: 0, xy: [] };
    const points = [];
    for (let i = 0; i < path.xy.length; i += 2) points.push(path.xy[i], path.xy[i + 1], world.ground + 0.01);
    return { ...world, palette: [], colors: WORLD_COLORS, surfaces,
      walls: this.ofKind('wall'), signs: this.ofKind('sign'), objects: this.ofKind('object'), free: this.ofKind('free'),
      racks: this.ofKind('compartment'),
      marks: this.marks(),
      surfaceIds: surfaces.filter((s) => !s.floor).map((s) => s.id),
      path: { length: path.length, points, stamps: [], poses: [] },
      places: [], planes: [], final: null, cores: null, cycles: null };
  }

  marks() {
    const made = [];
    if (this.spot && !this.found) made.push({ text: '+', at: this.spot, color: WORLD_COLORS.view });
    if (this.found) made.push({ text: 'put it here', at: this.found, color: WORLD_COLORS.object });
    return made;
  }

  rebuild() {
    if (!this.entities.has('world')) return;
    const scene = this.scene();
    if (this.report) {
      const before = JSON.stringify(this.report.scene.extent);
      this.report.load(scene, PLAIN);
      const { camera } = this.report;
      if (JSON.stringify(scene.extent) !== before && !camera.touched) camera.set(camera.home);
    } else {
      this.report = new Report(scene, PLAIN);
      this.listen();
    }
    if (this.picked !== null) this.show(this.picked);
  }

  listen() {
    const { canvas } = this.report;
    let down = [0, 0];
    canvas.addEventListener('pointerdown', (e) => { down = [e.clientX, e.clientY]; });
    canvas.addEventListener('click', (e) => {
      if (Math.hypot(e.clientX - down[0], e.clientY - down[1]) > DRAG_PX) return;
      const { left, top } = canvas.getBoundingClientRect();
      const [x, y] = [e.clientX - left, e.clientY - top];
      const entry = this.report.pick(x, y);
      if (!entry || entry.kind !== 'surface') return;
      const z = entry.at[2];
      this.spot = entry.floor ? null : [...this.report.pointAt(x, y, z), z];
      this.found = null;
      this.picked = entry.id;
      this.rebuild();
    });
  }

  // The figures of a surface beside the picture.
  show(id) {
    const surface = this.entities.get(`surface/${id}`);
    this.picked = surface ? id : null;
    const isFloor = !surface || surface.floor;
    const isFixed = isFloor || this.status.is_replay;
    if (isFloor) [this.spot, this.found] = [null, null];
    for (const form of ['rename', 'placement']) byId(form).hidden = isFixed;
    byId('naming').hidden = isFixed || !this.status.can_name;
    byId('picked').textContent = surface
      ? `${surface.label} ${surface.id}: ${surface.height.toFixed(3)} m over the floor, `
        + `${surface.size[0].toFixed(2)} x ${surface.size[1].toFixed(2)} m, ${surface.area.toFixed(2)} m², `
        + `${surface.views} view${surface.views === 1 ? '' : 's'}${surface.room ? `, room ${surface.room}` : ''}`
        + `${this.spot ? `; spot at ${this.spot.slice(0, 2).map((v) => v.toFixed(2)).join(', ')} m` : ''}`
      : 'Click a surface to see its figures.';
    if (surface && document.activeElement !== byId('label')) byId('label').value = surface.label;
  }

  showStatus() {
    const { localisation = 'no pose yet', nodes = {} } = this.status;
    const surfaces = this.ofKind('surface').filter((s) => !s.floor).length;
    const ready = this.status.ready !== false;
    byId('map').hidden = Boolean(this.status.is_replay);
    if (this.picked !== null) this.show(this.picked);
    this.say(ready ? `${surfaces} surfaces, ${this.ofKind('object').length} objects; ${localisation}`
      : 'slam_node does not run', !ready);
    byId('diagnostics').replaceChildren(...Object.entries(nodes).map(([name, text]) => {
      const row = document.createElement('tr');
      row.insertCell().textContent = name;
      row.insertCell().textContent = text;
      return row;
    }));
  }

  showEvents() {
    byId('events').replaceChildren(...this.events.map((text) => {
      const item = document.createElement('li');
      item.textContent = text;
      return item;
    }).reverse());
  }

  async submit(event, question) {
    event.preventDefault();
    byId('answer').textContent = '...';
    try {
      byId('answer').textContent = await question();
    } catch (error) {
      byId('answer').textContent = error.message;
    }
  }

  async ask(name, values) {
    const answer = await fetch(`ask/${name}`, { method: 'POST', body: JSON.stringify(values),
      headers: { 'Content-Type': 'application/json', 'X-Token': this.token } });
    const content = await answer.json();
    if (!answer.ok) throw new Error(content.error);
    return content;
  }

  async rename() {
    return (await this.ask('rename', { surface_id: this.picked, label: byId('label').value })).message;
  }

  async findPlacements() {
    const size = ['length', 'width', 'height'].map((id) => Number(byId(id).value));
    const { placements, message } = await this.ask('placements', { surface_id: this.picked, size });
    this.found = placements.length ? placements[0].position : null;
    this.rebuild();
    if (!placements.length) return message;
    const { position, clearance } = placements[0];
    return `put it at ${position.map((v) => v.toFixed(2)).join(', ')} m; ${clearance.toFixed(2)} m free around`;
  }

  async nameSpot() {
    const [name, spot] = [byId('spot').value, this.spot && this.spot.slice(0, 2)];
    const { message } = await this.ask('name', { surface_id: this.picked, name, spot });
    return `${name}: ${message}`;
  }

  async save() {
    return (await this.ask('save', { name: byId('name').value })).message;
  }
}

window.tccmLive = new Live();
