// Draws a posed robot on a plain canvas: one ray per pixel meets spheres, capsules and
// boxes, and a depth buffer lets parts pass through each other as they should.
"use strict";
const rays = (() => {
  function unit(v) { const l = Math.hypot(v[0], v[1], v[2]); return v.map(x => x / l); }
  function dot(a, b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
  function cross(a, b) {
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  }
  function matrix(q) { // w x y z to rows of a rotation, local to world
    const [w, x, y, z] = q;
    return [
      [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
      [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
      [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ];
  }
  function times(a, b) {
    return a.map(r => [0, 1, 2].map(c => r[0] * b[0][c] + r[1] * b[1][c] + r[2] * b[2][c]));
  }
  function apply(m, v) { return m.map(r => dot(r, v)); }
  function back(m, v) { // transpose of m times v
    return [0, 1, 2].map(c => m[0][c] * v[0] + m[1][c] * v[1] + m[2][c] * v[2]);
  }
  const LIGHT = unit([-0.42, -0.62, 1.15]); // towards the light, world frame

  // Screen place, depth and pixels per metre of a world point.
  function project(view, point) {
    const v = point.map((x, i) => x - view.eye[i]), depth = dot(v, view.forward);
    const scale = view.focal / Math.max(depth, 0.05);
    return [view.x + scale * dot(v, view.right), view.y - scale * dot(v, view.up), depth, scale];
  }
  function outline({ part, centre, turn }) { // points whose hull covers a part
    const s = part.size, points = [];
    if (part.shape === "box") {
      for (let k = 0; k < 8; k++) points.push(apply(turn, [k & 1 ? s[0] : -s[0], k & 2 ? s[1] : -s[1], k & 4 ? s[2] : -s[2]]).map((x, i) => x + centre[i]));
      return points;
    }
    const ends = part.shape === "capsule" ? [-s[1], s[1]] : [0];
    for (const end of ends) {
      const c = apply(turn, [0, 0, end]).map((x, i) => x + centre[i]);
      for (let k = 0; k < 12; k++) {
        const a = k * Math.PI / 6, side = unit(cross(LIGHT, [0, 1, 0])), other = cross(LIGHT, side);
        points.push(c.map((x, i) => x + s[0] * (Math.cos(a) * side[i] + Math.sin(a) * other[i])));
      }
    }
    return points;
  }
  function bounds(view, each) {
    const s = each.part.size, box = [1e9, 1e9, -1e9, -1e9];
    const radius = each.part.shape === "box" ? 0 : s[0];
    let points = [each.centre];
    if (each.part.shape === "capsule") points = [-s[1], s[1]].map(z => apply(each.turn, [0, 0, z]).map((x, i) => x + each.centre[i]));
    if (each.part.shape === "box") points = outline(each);
    for (const point of points) {
      const [x, y, depth, scale] = project(view, point);
      if (depth < 0.1) return null;
      const r = radius * scale * 1.06 + 1;
      box[0] = Math.min(box[0], x - r); box[1] = Math.min(box[1], y - r);
      box[2] = Math.max(box[2], x + r); box[3] = Math.max(box[3], y + r);
    }
    return box;
  }
  // Distance along the ray o + t d to a part at the origin of its own frame, or -1; the
  // normal there goes to `normal`.
  const normal = new Float64Array(3);
  function ball(ox, oy, oz, dx, dy, dz, r) {
    const a = dx * dx + dy * dy + dz * dz, b = ox * dx + oy * dy + oz * dz;
    const left = b * b - a * (ox * ox + oy * oy + oz * oz - r * r);
    if (left < 0) return -1;
    const t = (-b - Math.sqrt(left)) / a;
    normal[0] = (ox + t * dx) / r; normal[1] = (oy + t * dy) / r; normal[2] = (oz + t * dz) / r;
    return t;
  }
  function pill(ox, oy, oz, dx, dy, dz, r, h) {
    const a = dx * dx + dy * dy, b = ox * dx + oy * dy;
    const left = b * b - a * (ox * ox + oy * oy - r * r);
    if (left < 0) return -1;
    const t = a > 1e-12 ? (-b - Math.sqrt(left)) / a : 0, z = oz + t * dz;
    if (a <= 1e-12 || z > h || z < -h) {
      const end = (a <= 1e-12 ? oz : z) > 0 ? h : -h;
      return ball(ox, oy, oz - end, dx, dy, dz, r);
    }
    normal[0] = (ox + t * dx) / r; normal[1] = (oy + t * dy) / r; normal[2] = 0;
    return t;
  }
  function brick(ox, oy, oz, dx, dy, dz, s, bevel) {
    const o = [ox, oy, oz], d = [dx, dy, dz];
    let enter = -1e9, leave = 1e9, face = 0;
    for (let i = 0; i < 3; i++) {
      const inverse = 1 / (d[i] || 1e-12);
      let near = (-s[i] - o[i]) * inverse, far = (s[i] - o[i]) * inverse;
      if (near > far) { const swap = near; near = far; far = swap; }
      if (near > enter) { enter = near; face = i; }
      if (far < leave) leave = far;
    }
    if (enter > leave || leave < 0) return -1;
    let length = 0;
    for (let i = 0; i < 3; i++) { // bend the normal near the edges: a soft bevel
      const q = o[i] + enter * d[i], over = (Math.abs(q) - s[i]) / bevel + 1;
      const n = i === face ? 1 : over > 0 ? 0.9 * over * over : 0;
      normal[i] = q < 0 ? -n : n;
      length += n * n;
    }
    length = 1 / Math.sqrt(length);
    normal[0] *= length; normal[1] *= length; normal[2] *= length;
    return enter;
  }
  function cast(view, each, box, layer) {
    const { part, centre, turn } = each, shape = part.shape, s = part.size, h = s[1];
    const o = back(turn, view.eye.map((x, i) => x - centre[i])), r = back(turn, view.right);
    const u = back(turn, view.up), f = back(turn, view.forward), light = back(turn, LIGHT);
    const top = back(turn, [0, 0, 1]), middle = back(turn, unit(LIGHT.map((x, i) => x - view.forward[i])));
    const bevel = Math.min(0.008, 0.45 * Math.min(...s)), [red, green, blue] = part.colour.map(c => 255 * c);
    const x1 = Math.min(layer.width - 1, Math.ceil((box[2] - layer.x) * layer.grain));
    const y1 = Math.min(layer.height - 1, Math.ceil((box[3] - layer.y) * layer.grain));
    const x0 = Math.max(0, Math.floor((box[0] - layer.x) * layer.grain));
    for (let j = Math.max(0, Math.floor((box[1] - layer.y) * layer.grain)); j <= y1; j++) {
      const b = (view.y - layer.y - (j + 0.5) / layer.grain) / view.focal;
      for (let i = x0; i <= x1; i++) {
        const a = ((i + 0.5) / layer.grain + layer.x - view.x) / view.focal;
        const dx = f[0] + a * r[0] + b * u[0], dy = f[1] + a * r[1] + b * u[1], dz = f[2] + a * r[2] + b * u[2];
        const t = shape === "sphere" ? ball(o[0], o[1], o[2], dx, dy, dz, s[0])
          : shape === "capsule" ? pill(o[0], o[1], o[2], dx, dy, dz, s[0], h)
          : brick(o[0], o[1], o[2], dx, dy, dz, s, bevel);
        const k = j * layer.width + i;
        if (t <= 0 || t >= layer.depth[k]) continue;
        layer.depth[k] = t;
        const n0 = normal[0], n1 = normal[1], n2 = normal[2];
        const lit = Math.max(0, n0 * light[0] + n1 * light[1] + n2 * light[2]);
        const sky = n0 * top[0] + n1 * top[1] + n2 * top[2];
        let shine = Math.max(0, n0 * middle[0] + n1 * middle[1] + n2 * middle[2]);
        shine *= shine; shine *= shine; shine *= shine; shine *= shine; shine *= shine;
        const bright = 0.5 + 0.12 * sky + 0.46 * lit, gloss = 42 * shine, p = 4 * k;
        layer.pixels[p] = red * bright + gloss;
        layer.pixels[p + 1] = green * bright + gloss;
        layer.pixels[p + 2] = blue * (bright + 0.015) + gloss;
        layer.pixels[p + 3] = 255;
      }
    }
  }
  // Draws posed parts onto a context; `sheet` is a spare canvas, `grain` pixels per css pixel.
  function paint(context, sheet, grain, view, parts, width, height) {
    const boxes = parts.map(each => bounds(view, each)), all = [width, height, 0, 0];
    for (const box of boxes) if (box) {
      all[0] = Math.min(all[0], box[0]); all[1] = Math.min(all[1], box[1]);
      all[2] = Math.max(all[2], box[2]); all[3] = Math.max(all[3], box[3]);
    }
    const x = Math.max(0, Math.floor(all[0])), y = Math.max(0, Math.floor(all[1]));
    const w = Math.ceil((Math.min(width, all[2]) - x) * grain), h = Math.ceil((Math.min(height, all[3]) - y) * grain);
    if (w < 1 || h < 1) return;
    sheet.width = w; sheet.height = h;
    const spare = sheet.getContext("2d"), image = spare.createImageData(w, h);
    const layer = { x, y, width: w, height: h, grain, pixels: image.data, depth: new Float32Array(w * h).fill(1e9) };
    parts.forEach((each, index) => boxes[index] && each.part.colour[3] > 0.05 && cast(view, each, boxes[index], layer));
    spare.putImageData(image, 0, 0);
    context.imageSmoothingQuality = "high";
    context.drawImage(sheet, x, y, w / grain, h / grain);
  }

  return { LIGHT, unit, dot, cross, matrix, times, apply, project, outline, paint };
})();
