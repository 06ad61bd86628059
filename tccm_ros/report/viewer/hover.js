// What the pointer shows: the values of one object, as rows of a small table.

// Times are relative to the start of the recording.
let startStamp = 0;
const since = (stamp) => `${(stamp - startStamp).toFixed(1)} s`;

const metres = (value, digits = 2) => `${value.toFixed(digits)} m`;
const optional = (name, value, text) => (value === null || value === undefined ? [] : [[name, text(value)]]);

const FACTS = {
  surface: (s) => [`${s.label} (surface ${s.id})`, [
    ['height over floor', metres(s.height, 3)],
    ...optional('size', s.size, (v) => `${v.map((x) => x.toFixed(2)).join(' × ')} m`),
    ['area', `${s.area.toFixed(2)} m²`],
    ['views', String(s.views)],
    ...optional('points', s.points, String),
    ...optional('height spread', s.std, (v) => `${(v * 1000).toFixed(1)} mm`),
    ...optional('first seen', s.first, since),
    ...optional('last seen', s.last, since),
  ]],
  plane: (p) => [`plane ${p.id} of this cycle`, [
    ['kind', p.kind],
    ['height over floor', metres(p.height, 3)],
    ...optional('area', p.area, (v) => `${v.toFixed(2)} m²`),
    ...optional('points', p.support, String),
    ...optional('spread', p.rms, (v) => `${(v * 1000).toFixed(1)} mm`),
  ]],
  wall: (w) => [`wall ${w.id}`, [
    ['length', metres(w.length)],
    ...optional('observations', w.observations, String),
  ]],
  object: (o) => [`object ${o.id}`, [
    ...optional('stands on', o.on, String),
    ['size', o.size.map((v) => v.toFixed(2)).join(' × ') + ' m'],
  ]],
  free: (f) => ['free place', [['on', f.on]]],
  compartment: (c) => [`compartment over surface ${c.board}`, [
    ['clear height', metres(c.height, 3)],
    ['width', metres(c.width, 3)],
    ['depth', metres(c.depth, 3)],
    ['left, right', c.sides.join(', ')],
    ['back', c.back],
    ['ceiling', c.ceiling],
  ]],
  sign: (s) => [`door sign ${s.id}`, [['text', s.text]]],
  path: (p) => ['path of the base', [['length', metres(p.length)]]],
  view: (v) => ['place of a 3D view', [['time', since(v.stamp)], ['surfaces seen', String(v.surfaces)]]],
  cuboid: (c) => ['cuboid', [
    ['top over floor', metres(c.top, 3)],
    ['from cycle', String(c.cycle)],
    ...optional('points', c.points, String),
  ]],
};

function showHover(box, entry, x, y) {
  box.hidden = !entry;
  if (!entry) return;
  const [title, rows] = FACTS[entry.kind](entry);
  const heading = document.createElement('strong');
  heading.textContent = title;
  const table = document.createElement('table');
  for (const [name, value] of rows) {
    const row = table.insertRow();
    row.insertCell().textContent = name;
    row.insertCell().textContent = value;
  }
  box.replaceChildren(heading, table);
  const parent = box.parentElement;
  box.style.left = `${Math.min(x + 16, parent.clientWidth - box.offsetWidth - 4)}px`;
  box.style.top = `${Math.max(Math.min(y + 16, parent.clientHeight - box.offsetHeight - 4), 0)}px`;
}

// Names of surfaces, texts of signs, and marks, over the picture. Where two would cover each other a
// mark stays, or the nearer one.
class Labels {
  constructor(parent, { surfaces, signs, colors, marks = [] }) {
    const item = (kind, text, at, color) => {
      const element = document.createElement('span');
      element.textContent = text;
      element.style.borderColor = color;
      element.className = kind;
      parent.append(element);
      return { kind, element, at, width: element.offsetWidth, height: element.offsetHeight };
    };
    this.items = [
      ...marks.map((mark) => item('mark', mark.text, mark.at, mark.color)),
      ...surfaces.filter((s) => !s.floor).map((s) => item('surface', `${s.label} ${s.height.toFixed(2)} m`, s.at, s.color)),
      ...signs.map((s) => item('sign', s.text, s.at, colors.sign)),
    ];
  }

  // `layers` says of each kind whether it is shown.
  place(view, layers) {
    const seen = this.items.map((item) => ({ item, clip: toClip(view.matrix, item.at) }));
    seen.sort((a, b) => (b.item.kind === 'mark') - (a.item.kind === 'mark') || a.clip[3] - b.clip[3]);
    const taken = [];
    const [width, height] = [view.width / view.ratio, view.height / view.ratio];
    for (const { item, clip } of seen) {
      const x = (clip[0] / clip[3] * 0.5 + 0.5) * width;
      const y = (0.5 - clip[1] / clip[3] * 0.5) * height;
      const w = item.width / 2 + 3;
      const h = item.height / 2 + 2;
      const on = layers[item.kind];
      const free = clip[3] > 0 && x > w && y > h && x < width - w && y < height - h
        && taken.every((t) => Math.abs(t.x - x) >= t.w + w || Math.abs(t.y - y) >= t.h + h);
      item.element.hidden = !(on && free);
      if (on && free) {
        item.element.style.transform = `translate(-50%, -50%) translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
        taken.push({ x, y, w, h });
      }
    }
  }
}
