"""The script of the report: moves through a drive."""

SCRIPT = """
(() => {
  const data = JSON.parse(document.getElementById('drive-data').textContent);
  const stage = document.getElementById('drive'), svg = stage.querySelector('svg');
  const canvas = stage.querySelector('canvas'), ink = canvas.getContext('2d');
  const slider = document.getElementById('drive-time'), caption = document.getElementById('drive-caption');
  const play = document.getElementById('drive-play'), follow = document.getElementById('drive-follow');
  const whole = svg.getAttribute('viewBox').split(' ').map(Number);
  const screen = document.getElementById('drive-film');
  const frame = data.frame, layers = [...document.querySelectorAll('[data-layer]')];
  const metre = frame.width / (frame.x[1] - frame.x[0]);
  const at = (x, y) => [frame.left + (x - frame.x[0]) * metre, frame.top + (frame.y[1] - y) * metre];
  const shown = name => layers.every(box => box.dataset.layer !== name || box.checked);
  const last = (rows, t) => {  // the newest row that is not after t
    let low = 0, high = rows.length;
    while (low < high) { const k = (low + high) >> 1; if (rows[k][0] <= t) low = k + 1; else high = k; }
    return low - 1;
  };
  const placed = (pose, p) => {
    const c = Math.cos(pose[2]), s = Math.sin(pose[2]);
    return [pose[0] + c * p[0] - s * p[1], pose[1] + s * p[0] + c * p[1]];
  };
  const unpack = text => {
    const bytes = Uint8Array.from(atob(text), c => c.charCodeAt(0)), view = new DataView(bytes.buffer), points = [];
    for (let k = 0; k < bytes.length; k += 4)
      points.push([view.getInt16(k, true) / 100, view.getInt16(k + 2, true) / 100]);
    return points;
  };
  let cells = new Set(), done = -1;
  const cellsAt = t => {
    const k = last(data.obstacles, t);
    if (k < done) { cells = new Set(); done = -1; }
    for (; done < k; done++) {
      const [, added, gone] = data.obstacles[done + 1];
      added.forEach(cell => cells.add(cell.join())); gone.forEach(cell => cells.delete(cell.join()));
    }
    return [...cells].map(cell => cell.split(',').map(n => (Number(n) + 0.5) * data.cell_m));
  };
  let zoom = 1;  // marks and lines stay as thick as they are
  const rounds = [...svg.querySelectorAll('circle')].map(part => [part, Number(part.getAttribute('r'))]);
  const line = (points, colour, width, dash, close, fill) => {
    ink.beginPath(); points.forEach((p, k) => ink[k ? 'lineTo' : 'moveTo'](...at(...p)));
    if (close) ink.closePath();
    if (fill) { ink.fillStyle = fill; ink.fill(); }
    ink.setLineDash(dash.map(length => length / zoom)); ink.strokeStyle = colour; ink.lineWidth = width / zoom;
    ink.stroke();
  };
  const robot = (pose, colour, dash, fill) => {
    line(data.footprint.map(p => placed(pose, p)), colour, 1.8, dash, true, fill);
    line([[0, 0], [0.45, 0]].map(p => placed(pose, p)), colour, 1.8, []);
  };
  const dot = (x, y, size, colour) => { ink.fillStyle = colour; ink.fillRect(x - size / 2, y - size / 2, size, size); };
  const draw = () => {
    const t = Number(slider.value), k = Math.max(last(data.path, t), 0), row = data.path[k];
    const pose = row.slice(1, 4), view = [...whole];
    if (follow.checked) {
      const [x, y] = at(pose[0], pose[1]);
      view[2] = Math.min(whole[2], 14 * metre); view[3] = view[2] * whole[3] / whole[2];
      view[0] = Math.min(Math.max(x - view[2] / 2, 0), whole[2] - view[2]);
      view[1] = Math.min(Math.max(y - view[3] / 2, 0), whole[3] - view[3]);
    }
    svg.setAttribute('viewBox', view.join(' '));
    if (zoom !== whole[2] / view[2]) {
      zoom = whole[2] / view[2];
      rounds.forEach(([part, radius]) => part.setAttribute('r', radius / zoom));
    }
    const scale = 2 * stage.clientWidth / view[2];
    canvas.width = 2 * stage.clientWidth; canvas.height = canvas.width * whole[3] / whole[2];
    ink.setTransform(scale, 0, 0, scale, -scale * view[0], -scale * view[1]);
    const plan = last(data.plans, t), scan = last(data.scans, t), driving = plan >= 0 && data.plans[plan][1].length > 0;
    const seen = shown('costmap') ? cellsAt(t) : [];
    ink.fillStyle = '#e4d5c3'; ink.globalAlpha = 0.55; ink.beginPath();
    seen.forEach(([x, y]) => { const p = at(x, y), r = data.inscribed * metre; ink.moveTo(p[0] + r, p[1]);
      ink.arc(...p, r, 0, 7); });
    ink.fill(); ink.globalAlpha = 1;
    seen.forEach(([x, y]) => dot(...at(x, y), data.cell_m * metre, '#6b4f3a'));
    if (driving && scan >= 0 && shown('scan')) {
      const [, base, points] = data.scans[scan];
      unpack(points).forEach(p => dot(...at(...placed(base, p)), 3 / zoom, data.colours.scan));
    }
    if (driving && shown('plan')) line(data.plans[plan][1], data.colours.plan, 3, [7, 4]);
    for (const [name, rows] of Object.entries(data.estimates))
      if (shown(name) && last(rows, t) >= 0) robot(rows[last(rows, t)].slice(1), data.colours[name], [4, 3]);
    const fix = last(data.fixes, t);
    if (fix >= 0 && shown('gnss')) {
      ink.beginPath(); ink.arc(...at(data.fixes[fix][1], data.fixes[fix][2]), 6 / zoom, 0, 7);
      ink.setLineDash([]); ink.strokeStyle = data.colours.gnss; ink.lineWidth = 2.2 / zoom; ink.stroke();
    }
    if (row.length > 4 && shown('truth')) robot(row.slice(4), data.colours.truth, []);
    if (shown('ekf')) robot(pose, data.colours.ekf, [], 'rgba(59,130,196,.25)');
    if (screen) screen.src = data.film[Math.max(last(data.film, t), 0)][1];
    const plant = last(data.plants, t);
    caption.textContent = t.toFixed(1) + ' s' + (plant >= 0 ? ' \\u00b7 ' + data.plants[plant][1] : '') +
      (driving ? ' \\u00b7 drives' : '');
  };
  let timer = null;
  const stop = () => { clearInterval(timer); timer = null; play.textContent = '\\u25b6'; };
  play.onclick = () => {
    if (timer !== null) return stop();
    if (Number(slider.value) >= Number(slider.max)) slider.value = slider.min;
    play.textContent = '\\u275a\\u275a';
    timer = setInterval(() => {  // without a film, what happens while it stands is passed over
      const t = Number(slider.value), rows = screen ? data.film : data.path, next = rows[last(rows, t) + 1];
      slider.value = next ? Math.max(t + 0.5, next[0]) : slider.max;
      draw();
      if (!next) stop();
    }, screen ? 150 : 60);
  };
  slider.oninput = () => { stop(); draw(); };
  follow.onchange = draw;
  layers.forEach(box => box.onchange = () => {
    svg.querySelectorAll('.layer-' + box.dataset.layer).forEach(part => part.style.display = box.checked ? '' : 'none');
    draw();
  });
  window.addEventListener('resize', draw);
  draw();
})();
"""
