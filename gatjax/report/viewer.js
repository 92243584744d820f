// Plays recorded walks side by side: floor, shadow, camera and controls.
"use strict";
(function () {
  const source = document.getElementById("walks");
  const stage = document.getElementById("viewer");
  if (!source || !stage) return;
  const { LIGHT, unit, dot, cross, matrix, times, apply, project, outline, paint } = rays;
  const walks = JSON.parse(source.textContent).map(unpack);
  const HOME = { azimuth: -0.95, elevation: 0.2, distance: 2 };
  const FOCAL = 4.2; // focal length over half of the picture's height
  const TILE = 0.25; // m
  const camera = { ...HOME };
  const panes = [];
  let clock = 0, playing = false, speed = 1, before = 0, grain = 2, dirty = true;

  // ---- data ----
  function numbers(text) {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    return new Int16Array(bytes.buffer);
  }
  function unpack(walk) {
    walk.position = numbers(walk.position);
    walk.quaternion = numbers(walk.quaternion);
    walk.follow = numbers(walk.follow);
    walk.end = walk.time[walk.time.length - 1];
    for (const part of walk.geometry) part.turn = matrix(part.turn);
    return walk;
  }
  function frameAt(walk, time) { // index of the frame before, and how far to the next
    const times = walk.time;
    let low = 0, high = times.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= time) low = middle; else high = middle;
    }
    const gap = times[high] - times[low];
    const part = gap > 0 ? Math.min(1, Math.max(0, (time - times[low]) / gap)) : 0;
    return [low, high, part];
  }
  function mixed(walk, [low, high, part], index) {
    const a = walk.follow, s = walk.scale;
    return s * (a[3 * low + index] * (1 - part) + a[3 * high + index] * part);
  }
  function pose(walk, time) { // every part in the world: centre, rotation
    const at = frameAt(walk, time), [low, high, part] = at, n = walk.bodies, frames = [];
    for (let body = 0; body < n; body++) {
      const p = [0, 1, 2].map(i => walk.scale *
        (walk.position[3 * (low * n + body) + i] * (1 - part) +
         walk.position[3 * (high * n + body) + i] * part));
      const a = 4 * (low * n + body), b = 4 * (high * n + body), q = walk.quaternion;
      let sum = 0;
      for (let i = 0; i < 4; i++) sum += q[a + i] * q[b + i];
      const sign = sum < 0 ? -1 : 1, turn = [0, 1, 2, 3].map(
        i => q[a + i] * (1 - part) + sign * q[b + i] * part);
      const length = Math.hypot(...turn) || 1;
      frames.push([p, matrix(turn.map(x => x / length))]);
    }
    const parts = walk.geometry.map(part => {
      const [p, m] = frames[part.body], centre = apply(m, part.offset).map((x, i) => x + p[i]);
      return { part, centre, turn: times(m, part.turn) };
    });
    return { parts, middle: [0, 1, 2].map(i => mixed(walk, at, i)) };
  }

  // ---- camera ----
  function look(middle, width, height) {
    const { azimuth: a, elevation: e, distance: d } = camera;
    const out = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
    const target = [middle[0], middle[1], 0.25];
    const forward = out.map(x => -x), right = unit(cross(forward, [0, 0, 1]));
    return {
      eye: target.map((x, i) => x + d * out[i]), forward, right, up: cross(right, forward),
      focal: FOCAL * Math.min(height, width * 1.2) / 2, x: width / 2, y: height * 0.5,
    };
  }
  // ---- floor and shadow ----
  function css(name) { return getComputedStyle(stage).getPropertyValue(name).trim(); }
  function quad(context, view, corners) {
    context.beginPath();
    for (const corner of corners) {
      const [x, y, depth] = project(view, corner);
      if (depth < 0.1) return false;
      context.lineTo(x, y);
    }
    context.closePath();
    return true;
  }
  function drawFloor(context, view, middle, colours) {
    const reach = 2.4, i0 = Math.floor((middle[0] - reach) / TILE), j0 = Math.floor((middle[1] - reach) / TILE);
    const count = Math.ceil(2 * reach / TILE);
    context.fillStyle = colours.tile;
    for (let i = i0; i <= i0 + count; i++) for (let j = j0; j <= j0 + count; j++) {
      if ((i + j) & 1) continue;
      const x = i * TILE, y = j * TILE;
      const far = Math.hypot(x + TILE / 2 - middle[0], y + TILE / 2 - middle[1]) / reach;
      if (far >= 1) continue;
      context.globalAlpha = (1 - far) ** 1.3;
      if (quad(context, view, [[x, y, 0], [x + TILE, y, 0], [x + TILE, y + TILE, 0], [x, y + TILE, 0]])) context.fill();
    }
    context.globalAlpha = 1;
  }
  function drawMarks(context, view, walk, middle, colours) { // a line every half metre from the start
    const start = [walk.follow[0] * walk.scale, walk.follow[1] * walk.scale];
    const first = Math.max(0, Math.ceil((middle[0] - start[0] - 1.5) / 0.5));
    context.lineWidth = 1.2;
    context.font = "600 11px system-ui, sans-serif";
    for (let k = first; k < first + 6; k++) {
      const x = start[0] + 0.5 * k, far = Math.hypot(x - middle[0], start[1] - middle[1]) / 1.7;
      if (far >= 1) continue;
      const a = project(view, [x, start[1] - 0.3, 0]), b = project(view, [x, start[1] + 0.3, 0]);
      if (a[2] < 0.1 || b[2] < 0.1) continue;
      context.globalAlpha = Math.min(1, 1.6 * (1 - far));
      context.strokeStyle = context.fillStyle = colours.mark;
      context.beginPath(); context.moveTo(a[0], a[1]); context.lineTo(b[0], b[1]); context.stroke();
      if (a[0] > 0) context.fillText(k ? (0.5 * k).toFixed(1) + " m" : "start", a[0] + 5, a[1] + 4);
    }
    context.globalAlpha = 0.9;
    context.strokeStyle = colours.trail;
    context.lineWidth = 2;
    context.beginPath();
    const [now] = frameAt(walk, clock);
    for (let i = 0; i <= now; i += 2) {
      const p = project(view, [walk.follow[3 * i] * walk.scale, walk.follow[3 * i + 1] * walk.scale, 0]);
      if (p[2] > 0.3) context.lineTo(p[0], p[1]);
    }
    context.stroke();
    context.globalAlpha = 1;
  }
  function hull(points) {
    points.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const turnOf = (o, a, b) => (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
    const half = list => {
      const out = [];
      for (const p of list) {
        while (out.length > 1 && turnOf(out[out.length - 2], out[out.length - 1], p) <= 0) out.pop();
        out.push(p);
      }
      out.pop();
      return out;
    };
    return half(points).concat(half(points.slice().reverse()));
  }
  function drawShadow(context, view, parts, colours) {
    context.beginPath();
    for (const each of parts) {
      const flat = outline(each).map(p => {
        const t = Math.max(0, p[2]) / LIGHT[2];
        return project(view, [p[0] - t * LIGHT[0], p[1] - t * LIGHT[1], 0]);
      });
      hull(flat).forEach((p, i) => (i ? context.lineTo(p[0], p[1]) : context.moveTo(p[0], p[1])));
      context.closePath();
    }
    context.save();
    context.filter = "blur(2.5px)";
    context.globalAlpha = colours.shadow;
    context.fillStyle = "#000";
    context.fill("nonzero");
    context.restore();
  }

  // ---- panes and controls ----
  function draw(pane) {
    const width = pane.canvas.clientWidth, height = pane.canvas.clientHeight, ratio = Math.min(2, devicePixelRatio || 1);
    if (pane.canvas.width !== Math.round(width * ratio) || pane.canvas.height !== Math.round(height * ratio)) {
      pane.canvas.width = Math.round(width * ratio); pane.canvas.height = Math.round(height * ratio);
    }
    const context = pane.context, walk = pane.walk, time = Math.min(clock, walk.end);
    const colours = { tile: css("--tile"), mark: css("--faint"), trail: css("--accent"), shadow: +css("--shadow") };
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const { parts, middle } = pose(walk, time), view = look(middle, width, height);
    drawFloor(context, view, middle, colours);
    drawMarks(context, view, walk, middle, colours);
    drawShadow(context, view, parts, colours);
    paint(context, pane.sheet, grain, view, parts, width, height);
    const gone = Math.hypot(middle[0] - walk.follow[0] * walk.scale, middle[1] - walk.follow[1] * walk.scale);
    pane.note.textContent = gone.toFixed(2) + " m" + (clock > walk.end ? (walk.fell ? " \u00b7 fell at " : " \u00b7 ended at ") + walk.end.toFixed(1) + " s" : "");
  }
  function longest() { return Math.max(...panes.map(pane => pane.walk.end), 0.04); }
  function make(tag, attributes, parent) {
    const element = Object.assign(document.createElement(tag), attributes);
    parent.append(element);
    return element;
  }
  const room = make("div", { className: "panes" }, stage);
  for (let index = 0; index < Math.min(2, walks.length); index++) {
    const box = make("figure", { className: "pane" }, room), head = make("figcaption", {}, box);
    const choice = make("select", { ariaLabel: index ? "second walk" : "first walk" }, head);
    walks.forEach((walk, k) => make("option", { value: k, textContent: walk.label, selected: k === index }, choice));
    const note = make("output", {}, head), canvas = make("canvas", {}, box);
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "animation of a walk; drag to turn the view");
    const pane = { canvas, note, walk: walks[index], context: canvas.getContext("2d"), sheet: document.createElement("canvas") };
    panes.push(pane);
    choice.onchange = () => { pane.walk = walks[+choice.value]; slider.max = longest(); dirty = true; };
    canvas.onpointerdown = event => { canvas.setPointerCapture(event.pointerId); };
    canvas.onpointermove = event => {
      if (!canvas.hasPointerCapture(event.pointerId)) return;
      camera.azimuth -= 0.008 * event.movementX;
      camera.elevation = Math.min(1.4, Math.max(0.02, camera.elevation + 0.006 * event.movementY));
      dirty = true;
    };
    canvas.ondblclick = () => { Object.assign(camera, HOME); dirty = true; };
  }
  const bar = make("div", { className: "controls" }, stage);
  const button = make("button", { type: "button" }, bar);
  const slider = make("input", { type: "range", min: 0, max: longest(), step: 0.02, value: 0, ariaLabel: "time" }, bar);
  const readout = make("output", {}, bar);
  const pace = make("select", { ariaLabel: "speed" }, bar);
  for (const value of [0.1, 0.25, 0.5, 1, 2]) make("option", { value, textContent: value + "\u00d7", selected: value === 1 }, pace);
  function play(on) {
    playing = on;
    if (on && clock >= longest()) clock = 0;
    button.textContent = on ? "Pause" : "Play";
    before = performance.now();
  }
  button.onclick = () => play(!playing);
  pace.onchange = () => { speed = +pace.value; };
  slider.oninput = () => { clock = +slider.value; dirty = true; };
  function tick(now) {
    if (playing) {
      clock += speed * Math.min(0.1, (now - before) / 1000);
      if (clock > longest() + 0.7) clock = 0;
      dirty = true;
    }
    before = now;
    if (dirty) {
      dirty = false;
      const begun = performance.now();
      panes.forEach(draw);
      const spent = performance.now() - begun; // coarser pixels where the machine is slow
      if (spent > 30 && grain > 0.8) grain *= 0.85; else if (spent < 9 && grain < 2) grain = Math.min(2, grain * 1.03);
      slider.value = clock;
      readout.textContent = Math.min(clock, longest()).toFixed(1) + " s";
    }
    requestAnimationFrame(tick);
  }
  play(false);
  addEventListener("resize", () => { dirty = true; });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { dirty = true; });
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  if (!still && "IntersectionObserver" in window) {
    const watch = new IntersectionObserver(entries => {
      if (entries.some(entry => entry.isIntersecting)) { play(true); watch.disconnect(); }
    }, { threshold: 0.3 });
    watch.observe(stage);
  }
  requestAnimationFrame(tick);
})();
