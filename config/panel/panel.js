'use strict';
// Everything from the machine goes through textContent and numbers: nothing of it can become markup.
const LOST = 1500, AGAIN = 2000, SPAN = 60;  // ms without a view, ms to the next try, s of the traces
const byId = (id) => document.getElementById(id);
const rows = new Map();  // of the traces, by gondola
let heard = -Infinity, source;

function text(node, words) { if (node.textContent !== words) node.textContent = words; }
function set(node, values) { for (const [name, value] of Object.entries(values)) node.setAttribute(name, value); }

// Let `parent` have a child for each item, kept where it stands: a screen reader hears what changes.
function fill(parent, items, make, write) {
  while (parent.children.length > items.length) parent.lastElementChild.remove();
  while (parent.children.length < items.length) parent.append(make());
  items.forEach((item, k) => write(parent.children[k], item, k));
}
const element = (name) => () => document.createElement(name);
function words(node, item, name = '') {
  text(node, item.text);
  const kind = `${name} ${item.level}`.trim();
  if (node.className !== kind) node.className = kind;
}

function table(node, shown) {
  if (!node.tHead) { node.createTHead().insertRow(); node.createTBody(); }
  const kind = (k) => (shown.heads[k].startsWith('>') ? 'number' : '');
  fill(node.tHead.rows[0], shown.heads, element('th'), (cell, head, k) => {
    text(cell, head.replace(/^>/, '')); cell.className = kind(k); cell.scope = 'col'; });
  fill(node.tBodies[0], shown.rows, element('tr'), (row, cells) =>
    fill(row, cells, element('td'), (cell, item, k) => words(cell, item, kind(k))));
}

function picture(svg, shown) {
  const [least, greatest] = shown.rail, part = (name) => svg.querySelector(`.${name}`), j = shown.joints;
  set(svg, {viewBox: `${least - 80} ${-shown.reach - 40} ${greatest - least + 160} ${shown.reach + 100}`});
  const line = (name, ends) => {
    part(name).style.display = ends ? '' : 'none';
    if (ends) set(part(name), {x1: ends[0][0], y1: ends[0][1], x2: ends[1][0], y2: ends[1][1]});
  };
  line('rail', [[least, 0], [greatest, 0]]);
  line('wall', shown.wall);
  line('platform', j && [j.b1, j.b2]);
  line('slide', j && [j.a3, j.p]);
  set(part('links'), {points: ''});
  svg.querySelectorAll('.carriage, .head, .target').forEach((one) => { one.style.display = 'none'; });
  if (j) {
    set(part('links'), {points: [j.a1, j.b1, j.b2, j.a2].join(' ')});
    svg.querySelectorAll('.carriage').forEach((one, k) => {
      one.style.display = '';
      set(one, {x: j[`a${k + 1}`][0] - shown.carriage, y: -16, width: 2 * shown.carriage, height: 32});
    });
    part('head').style.display = '';
    set(part('head'), {cx: j.p[0], cy: j.p[1]});
  }
  if (shown.target) {
    const [x, y] = shown.target;
    part('target').style.display = '';
    set(part('target'), {d: `M${x - 30} ${y}h60M${x} ${y - 30}v60`});
  }
}

function traces(node, name) {
  const known = rows.get(name), now = known[known.length - 1][0];
  for (const [kind, columns, least, unit, title] of [
    ['residual', [1], 1, 'mm', 'head from the corrected goal'], ['forces', [2, 3, 4], 10, 'N', 'forces of q1, q2, q3']]) {
    const values = columns.flatMap((k) => known.map((row) => row[k])).filter((value) => value !== null);
    const top = Math.max(least, ...values.map(Math.abs)), bottom = kind === 'forces' ? -top : 0;
    const newest = columns.map((k) => known[known.length - 1][k]).map((v) => (v === null ? '–' : v.toFixed(1)));
    text(node.querySelector(`.${kind}-title`),
      `${title}: ${newest.join(', ')} ${unit}; last minute, ${bottom ? '±' : 'up to '}${top.toFixed(1)} ${unit}`);
    node.querySelectorAll(`.${kind} path`).forEach((path, n) => {
      let d = '', pen = 'M';
      for (const row of known) {
        const value = row[columns[n]];
        if (value === null) { pen = 'M'; continue; }
        d += `${pen}${(600 * (1 - (now - row[0]) / SPAN)).toFixed(1)} ${(120 * (top - value) / (top - bottom)).toFixed(1)}`;
        pen = 'L';
      }
      set(path, {d});
    });
  }
}

function show(view) {
  fill(byId('gondolas'), view.gondolas, () => byId('gondola').content.firstElementChild.cloneNode(true), (node, shown) => {
    words(node.querySelector('.state'), shown.title, 'state');
    fill(node.querySelector('.troubles'), shown.troubles, element('li'), (item, one) => words(item, one));
    const kept = (rows.get(shown.name) || []).filter((row) => row[0] > shown.row[0] - SPAN && row[0] < shown.row[0]);
    rows.set(shown.name, [...kept, shown.row]);
    picture(node.querySelector('.picture'), shown.picture);
    traces(node, shown.name);
    fill(node.querySelector('.tables'), shown.tables, element('table'), table);
  });
  for (const name of rows.keys()) if (!view.gondolas.some((one) => one.name === name)) rows.delete(name);
  byId('more').hidden = !view.more;
  text(byId('more'), `${view.more} more gondolas are not shown; next: panel --namespace NAME`);
  const wrong = view.doctor.filter(([, what]) => what);
  text(byId('doctor-title'), `this computer (doctor): ${view.doctor.length ? wrong.length ? `${wrong.length} wrong` : 'in order' : 'not looked at yet'}`);
  fill(byId('doctor'), view.doctor, element('li'), (item, [name, what]) => text(item, what ? `WRONG ${name}: ${what}` : `ok ${name}`));
  text(byId('files-title'), `black box: ${view.files.length} newest files`);
  fill(byId('files'), view.files, () => { const item = document.createElement('li'); item.append(document.createElement('a')); return item; },
    (item, [name, size]) => { set(item.firstChild, {href: `files/${encodeURIComponent(name)}`, download: name});
      text(item.firstChild, `${name} (${(size / 1e6).toFixed(1)} MB)`); });
}

// What is not known any more is not shown: the page is empty but for that sentence.
function lose(lost) {
  if (byId('lost').hidden !== lost) return;
  byId('lost').hidden = !lost;
  byId('rest').hidden = lost;
  if (lost) { rows.clear(); byId('gondolas').replaceChildren(); byId('more').hidden = true; }
}

function connect() {
  if (source) source.close();
  source = new EventSource('events');
  source.addEventListener('past', (event) => { for (const [name, past] of Object.entries(JSON.parse(event.data))) rows.set(name, past); });
  source.addEventListener('view', (event) => { show(JSON.parse(event.data)); heard = performance.now(); lose(false); });
  source.onerror = () => lose(true);
}

connect();
let tried = performance.now();
setInterval(() => {
  const now = performance.now();
  if (now - heard > LOST) lose(true);
  if (now - Math.max(heard, tried) > AGAIN) { tried = now; connect(); }
}, 250);
