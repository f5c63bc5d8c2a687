// Draws the states of a simulation: of a film that is in this page, or of a session that a server sends. Lengths in m unless px is said.
const $ = id => document.getElementById(id);
const json = id => JSON.parse($(id)?.textContent ?? "null");
const make = (name, attributes = {}, ...inside) => {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) key in element && key !== "list" ? element[key] = value : element.setAttribute(key, value);
  element.append(...inside);
  return element;
};
const head = json("head"), style = head.style;
const rgb = text => [1, 3, 5].map(k => parseInt(text.slice(k, k + 2), 16));
const table = text => Uint8Array.from({ length: text.length / 2 }, (_, k) => parseInt(text.slice(2 * k, 2 * k + 2), 16));
const maps = Object.fromEntries(Object.entries(style.maps).map(([name, text]) => [name, table(text)]));
const FIXED = rgb(style.fixed), DIM = rgb(style.dim), BOND = rgb(style.bond), GROUND = rgb(style.ground), FOAM = rgb(style.foam);
const TEXT = [230, 232, 235], ACCENT = [242, 166, 90];

function blend(cold, hot) { // as light is mixed; see palette.blend_map
  const ends = [cold, hot].map(end => rgb(end).map(c => (c / 255) ** 2.2));
  return Uint8Array.from({ length: 768 }, (_, k) => 255 * (ends[0][k % 3] + (ends[1][k % 3] - ends[0][k % 3]) * Math.floor(k / 3) / 255) ** (1 / 2.2) + 0.5);
}

function number(value) { // three digits, as captions have them
  if (value === null || !Number.isFinite(value)) return "–";
  if (value === 0 || (Math.abs(value) >= 1e-3 && Math.abs(value) < 1e5)) return String(Number(value.toPrecision(3)));
  return value.toExponential(1).replace("e+", "e");
}

// Bytes -> frames

const KINDS = { u1: Uint8Array, u2: Uint16Array, i4: Int32Array, f4: Float32Array };

function unpack(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const about = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const planes = {};
  let at = 4 + length;
  for (const [name, kind, size] of about.planes) {
    const Kind = KINDS[kind], end = at + size * Kind.BYTES_PER_ELEMENT;
    planes[name] = new Kind(buffer.slice(at, at = end));
  }
  return [about, planes];
}

const rosterOf = planes => Object.fromEntries(["grain", "disc", "kind", "fixed", "radius", "tone"].map(name => [name, planes[name]]));

function places(high, low, n, frames) { // see `foreseen` and `halves` in output/html.py
  const found = [];
  for (let f = 0; f < frames; f++) {
    const now = new Uint16Array(n), one = found[f - 1], two = found[f - 2];
    for (let k = 0, at = f * n; k < n; k++, at++) {
      const code = high[at] << 8 | low[at];
      const led = two ? 2 * one[k] - two[k] : one ? one[k] : 0;
      now[k] = led + (code >> 1 ^ -(code & 1));
    }
    found.push(now);
  }
  return found;
}

function bytes(plane, n, frames) { // see `steps` there
  for (let k = n; k < plane.length; k++) plane[k] += plane[k - n];
  return Array.from({ length: frames }, (_, f) => plane.subarray(f * n, (f + 1) * n));
}

const finer = plane => plane.map(value => (value * 255 + (head.steps >> 1)) / head.steps);

function chainsOf(planes, from, count) {
  const first = planes["chain first"].slice(from, from + count);
  for (let k = 1; k < count; k++) first[k] += first[k - 1];
  const cut = name => planes[`chain ${name}`].subarray(from, from + count);
  return { first, second: Int32Array.from(cut("second"), row => row === 65535 && first.BYTES_PER_ELEMENT === 2 ? -1 : row), level: finer(cut("level")), way: cut("way") };
}

async function groupOf(buffer, rosterAt) {
  const [about, planes] = unpack(buffer);
  const n = about.rows, count = about.frames.length, roster = await rosterAt(about.roster);
  const x = places(planes["x high"], planes["x low"], n, count), y = places(planes["y high"], planes["y low"], n, count);
  const angle = bytes(planes.angle, n, count), flags = bytes(planes.flags, n, count);
  const shades = Object.keys(planes).filter(name => name.startsWith("shade ")).map(name => [name.slice(6), bytes(planes[name], n, count).map(finer)]);
  const nodes = about.water ? about.water[0] * about.water[1] : 0;
  const water = about.water && ["level", "foam", "shade"].map(name => bytes(planes[`water ${name}`], nodes, count));
  let walls = null, bonds = null, chains = null, wall = 0, bond = 0, chain = 0;
  return about.frames.map((frame, f) => {
    if (frame.walls !== undefined) walls = planes.walls.subarray(wall, wall += 4 * frame.walls);
    if (frame.bonds !== undefined) bonds = planes.bonds.subarray(bond, bond += 2 * frame.bonds);
    if (frame.chains !== undefined) {
      chains = { ...chainsOf(planes, chain, frame.chains), top: frame.tops.chains };
      chain += frame.chains;
    }
    return {
      ...frame, scene: about.scene, roster, x: x[f], y: y[f], angle: angle[f], flags: flags[f], walls, bonds, chains,
      shades: Object.fromEntries(shades.map(([name, all]) => [name, all[f]])),
      water: water && { columns: about.water[0], rows: about.water[1], level: water[0][f], foam: water[1][f], shade: water[2][f] },
    };
  });
}

// Painting: by WebGL2, or by the canvas's own means where there is none

const DISC = [`#version 300 es
  in vec2 corner; in vec4 place; in vec4 tint; uniform vec3 map; uniform vec2 half_size; out vec2 at; out vec3 colour; flat out vec4 form;
  void main() {
    float radius = place.z * map.z, shown = max(radius, 1.0);
    at = corner * (shown + 1.0);
    vec2 pixel = place.xy * map.z + map.xy + at;
    colour = tint.rgb; form = vec4(radius, shown, place.w, tint.a);
    gl_Position = vec4(pixel / half_size - 1.0, 0.0, 1.0);
  }`, `#version 300 es
  precision highp float; in vec2 at; in vec3 colour; flat in vec4 form; uniform float spoke[5]; out vec4 painted;
  void main() {
    float r = form.x, shown = form.y, cover = clamp((shown * shown + shown - dot(at, at)) / (2.0 * shown), 0.0, 1.0);
    if (cover <= 0.0) discard;
    vec3 c = colour;
    if (form.w > 0.5 && r > spoke[3]) {
      float part = min(1.0, (r - spoke[3]) / (spoke[4] - spoke[3])), wide = spoke[2] * r;
      vec2 tip = (spoke[1] - 0.5 * spoke[2]) * r * vec2(cos(form.z), sin(form.z));
      float along = clamp(dot(at, tip) / max(dot(tip, tip), 1e-9), 0.0, 1.0);
      float share = clamp(0.5 * max(wide, 1.0) + 0.5 - length(at - along * tip), 0.0, 1.0) * min(wide, 1.0);
      c *= 1.0 - (1.0 - spoke[0]) * part * share;
    }
    painted = vec4(c, cover * (r / shown) * (r / shown));
  }`];
const LINE = [`#version 300 es
  in vec2 corner; in vec4 place; in vec4 tint; in float width; uniform vec3 map; uniform vec2 half_size; out vec2 at; out vec4 colour; flat out vec2 form;
  void main() {
    vec2 a = place.xy * map.z + map.xy, b = place.zw * map.z + map.xy, way = b - a;
    float size = length(way), pad = 0.5 * max(width, 1.0) + 0.5;
    vec2 along = size > 1e-6 ? way / size : vec2(1.0, 0.0), side = vec2(-along.y, along.x);
    at = vec2(corner.x > 0.0 ? size + pad : -pad, corner.y * pad);
    vec2 pixel = a + along * at.x + side * at.y;
    colour = vec4(tint.rgb, tint.a * min(width, 1.0)); form = vec2(size, pad);
    gl_Position = vec4(pixel / half_size - 1.0, 0.0, 1.0);
  }`, `#version 300 es
  precision highp float; in vec2 at; in vec4 colour; flat in vec2 form; out vec4 painted;
  void main() {
    float away = length(vec2(at.x - clamp(at.x, 0.0, form.x), at.y)), cover = clamp(form.y - away, 0.0, 1.0);
    if (cover <= 0.0) discard;
    painted = vec4(colour.rgb, colour.a * cover);
  }`];
const WATER = [`#version 300 es
  in vec2 corner; uniform vec3 map; uniform vec2 half_size; uniform vec2 size; out vec2 at;
  void main() { at = 0.5 * corner + 0.5; gl_Position = vec4((at * size * map.z + map.xy) / half_size - 1.0, 0.0, 1.0); }`, `#version 300 es
  precision highp float; in vec2 at; uniform sampler2D wet; uniform sampler2D deep; uniform vec2 nodes; uniform vec3 foam; uniform vec2 levels;
  uniform float strength; out vec4 painted;
  void main() {
    vec3 w = texture(wet, (at * (nodes - 1.0) + 0.5) / nodes).rgb;
    float depth = levels.x + w.r * (levels.y - levels.x), white = max(0.45 * (1.0 - smoothstep(0.1, 0.55, depth)), 0.75 * w.g);
    painted = vec4(mix(texture(deep, vec2((w.b * 255.0 + 0.5) / 256.0, 0.5)).rgb, foam, white), strength * smoothstep(-0.1, 0.1, depth));
  }`];

class Gl {
  constructor(canvas) {
    const gl = this.gl = canvas.getContext("webgl2", { alpha: false, antialias: false, powerPreference: "high-performance" });
    if (!gl) throw new Error("no WebGL2");
    this.canvas = canvas;
    this.quad = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.quad);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]), gl.STATIC_DRAW);
    this.disc = this.program(DISC, [["place", 4, gl.FLOAT, false, 16], ["tint", 4, gl.UNSIGNED_BYTE, true, 4]]);
    this.line = this.program(LINE, [["place", 4, gl.FLOAT, false, 16], ["tint", 4, gl.UNSIGNED_BYTE, true, 4], ["width", 1, gl.FLOAT, false, 4]]);
    this.wet = this.program(WATER, []);
    this.textures = [gl.createTexture(), gl.createTexture()];
    gl.useProgram(this.disc.program);
    gl.uniform1fv(this.disc.at("spoke"), style.spoke);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  }

  program(sources, columns) {
    const gl = this.gl, program = gl.createProgram();
    sources.forEach((source, k) => {
      const shader = gl.createShader(k ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    });
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? "no shaders");
    const array = gl.createVertexArray(), buffers = [], known = {};
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.quad);
    const corner = gl.getAttribLocation(program, "corner");
    gl.enableVertexAttribArray(corner);
    gl.vertexAttribPointer(corner, 2, gl.FLOAT, false, 0, 0);
    for (const [name, size, type, normal] of columns) {
      const place = gl.getAttribLocation(program, name), buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, type, normal, 0, 0);
      gl.vertexAttribDivisor(place, 1);
      buffers.push(buffer);
    }
    return { program, array, buffers, at: name => known[name] ??= gl.getUniformLocation(program, name) };
  }

  use(one, map) {
    const gl = this.gl;
    gl.useProgram(one.program);
    gl.bindVertexArray(one.array);
    gl.uniform3f(one.at("map"), ...map);
    gl.uniform2f(one.at("half_size"), this.canvas.width / 2, this.canvas.height / 2);
  }

  many(one, map, count, ...columns) {
    const gl = this.gl;
    this.use(one, map);
    columns.forEach((column, k) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, one.buffers[k]);
      gl.bufferData(gl.ARRAY_BUFFER, column, gl.STREAM_DRAW);
    });
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, count);
  }

  clear() {
    const gl = this.gl;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(...GROUND.map(c => c / 255), 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
  }

  discs(map, count, place, tint) { this.many(this.disc, map, count, place.subarray(0, 4 * count), tint.subarray(0, 4 * count)); }

  lines(map, count, place, tint, width) {
    if (count) this.many(this.line, map, count, place.subarray(0, 4 * count), tint.subarray(0, 4 * count), width.subarray(0, count));
  }

  water(map, size, water, strength) {
    const gl = this.gl, { columns, rows } = water;
    this.use(this.wet, map);
    const pixels = water.pixels ??= woven(water.level, water.foam, water.shade);
    [[0, columns, rows, pixels], [1, 256, 1, maps.water]].forEach(([unit, wide, high, data]) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, this.textures[unit]);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, wide, high, 0, gl.RGB, gl.UNSIGNED_BYTE, data);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
      for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    });
    gl.uniform1i(this.wet.at("wet"), 0);
    gl.uniform1i(this.wet.at("deep"), 1);
    gl.uniform2f(this.wet.at("nodes"), columns, rows);
    gl.uniform2f(this.wet.at("size"), ...size);
    gl.uniform2f(this.wet.at("levels"), ...style.levels);
    gl.uniform3f(this.wet.at("foam"), ...FOAM.map(c => c / 255));
    gl.uniform1f(this.wet.at("strength"), strength);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }
}

function woven(...planes) {
  const found = new Uint8Array(planes.length * planes[0].length);
  planes.forEach((plane, k) => plane.forEach((value, at) => { found[planes.length * at + k] = value; }));
  return found;
}

class Flat {
  constructor(canvas) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d", { alpha: false });
    this.pool = make("canvas");
  }

  clear() {
    this.pen.fillStyle = style.ground;
    this.pen.fillRect(0, 0, this.canvas.width, this.canvas.height);
  }

  discs([left, low, scale], count, place, tint) {
    const pen = this.pen, height = this.canvas.height, [dark, reach, wide, least] = style.spoke;
    for (let k = 0; k < count; k++) {
      const x = place[4 * k] * scale + left, y = height - place[4 * k + 1] * scale - low, r = place[4 * k + 2] * scale;
      if (x + r < 0 || y + r < 0 || x - r > this.canvas.width || y - r > height) continue;
      const colour = tint.subarray(4 * k, 4 * k + 3);
      pen.fillStyle = `rgb(${colour.join()})`;
      pen.beginPath();
      pen.arc(x, y, r, 0, 7);
      pen.fill();
      if (!tint[4 * k + 3] || r < least) continue;
      const angle = place[4 * k + 3], tip = (reach - wide / 2) * r;
      pen.strokeStyle = `rgb(${[...colour].map(c => Math.round(dark * c)).join()})`;
      pen.lineWidth = wide * r;
      pen.lineCap = "round";
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x + tip * Math.cos(angle), y - tip * Math.sin(angle));
      pen.stroke();
    }
  }

  lines([left, low, scale], count, place, tint, width) {
    const pen = this.pen, height = this.canvas.height;
    pen.lineCap = "round";
    for (let k = 0; k < count; k++) {
      const [r, g, b, a] = tint.subarray(4 * k, 4 * k + 4);
      pen.strokeStyle = `rgba(${r},${g},${b},${a / 255})`;
      pen.lineWidth = width[k];
      pen.beginPath();
      pen.moveTo(place[4 * k] * scale + left, height - place[4 * k + 1] * scale - low);
      pen.lineTo(place[4 * k + 2] * scale + left, height - place[4 * k + 3] * scale - low);
      pen.stroke();
    }
  }

  water([left, low, scale], size, water, strength) {
    const { columns, rows } = water, image = new ImageData(columns, rows), step = (a, b, x) => Math.min(1, Math.max(0, (x - a) / (b - a)));
    for (let k = 0; k < columns * rows; k++) {
      const to = 4 * ((rows - 1 - Math.floor(k / columns)) * columns + k % columns), deep = style.levels[0] + water.level[k] / 255 * (style.levels[1] - style.levels[0]);
      const white = Math.max(0.45 * (1 - step(0.1, 0.55, deep)), 0.75 * water.foam[k] / 255);
      for (let c = 0; c < 3; c++) image.data[to + c] = maps.water[3 * water.shade[k] + c] * (1 - white) + FOAM[c] * white;
      image.data[to + 3] = 255 * strength * step(-0.1, 0.1, deep);
    }
    this.pool.width = columns;
    this.pool.height = rows;
    this.pool.getContext("2d").putImageData(image, 0, 0);
    this.pen.drawImage(this.pool, left, this.canvas.height - low - size[1] * scale, size[0] * scale, size[1] * scale);
  }
}

// The picture

class Picture {
  constructor(canvas) {
    this.canvas = canvas;
    this.look = { color: "kind", chains: false, asleep: true, bonds: true, hud: true };
    this.room = 0;
    this.grow(1024);
    this.lineCount = 0;
    this.linePlace = new Float32Array(4096);
    this.lineTint = new Uint8Array(4096);
    this.lineWidth = new Float32Array(1024);
    this.camera = null;
    this.extra = []; // lines over the picture: [x, y, x, y, width px, colour, alpha]
    this.frame = this.next = null;
    this.share = 0;
    const plain = new URLSearchParams(location.search).has("flat");
    try {
      if (plain) throw new Error("asked for");
      this.paint = new Gl(canvas);
    } catch { // a canvas keeps to the first kind of context that it gave
      this.canvas = canvas.cloneNode();
      canvas.replaceWith(this.canvas);
      this.paint = new Flat(this.canvas);
    }
    this.canvas.addEventListener("webglcontextlost", event => { event.preventDefault(); });
    this.canvas.addEventListener("webglcontextrestored", () => { this.paint = new Gl(this.canvas); this.stale = true; });
    new ResizeObserver(() => this.fit()).observe(this.canvas.parentElement);
    this.stale = true;
  }

  fit() {
    const { width, height } = this.canvas.parentElement.getBoundingClientRect();
    this.ratio = devicePixelRatio || 1;
    this.canvas.width = Math.max(1, Math.round(width * this.ratio));
    this.canvas.height = Math.max(1, Math.round(height * this.ratio));
    this.stale = true;
  }

  get scene() { return (this.next ?? this.frame)?.scene; }

  // Pixel of the lower left corner of the box, and px/m: x px = map[0] + map[2] * x, y px from below.
  get map() {
    const { width, height } = this.canvas, size = this.scene.size;
    const least = Math.min(width / size[0], height / size[1]);
    const camera = this.camera ?? { x: size[0] / 2, y: size[1] / 2, zoom: 1 };
    const scale = least * camera.zoom;
    return [width / 2 - camera.x * scale, height / 2 - camera.y * scale, scale];
  }

  point(event) { // of the world, under the mouse
    const box = this.canvas.getBoundingClientRect(), [left, low, scale] = this.map;
    return [((event.clientX - box.left) * this.ratio - left) / scale, (this.canvas.height - (event.clientY - box.top) * this.ratio - low) / scale];
  }

  zoom(factor, event) {
    if (!this.scene) return;
    const size = this.scene.size, [x, y] = event ? this.point(event) : [size[0] / 2, size[1] / 2];
    const now = this.camera ?? { x: size[0] / 2, y: size[1] / 2, zoom: 1 };
    const zoom = Math.min(200, Math.max(0.25, now.zoom * factor)), part = now.zoom / zoom;
    this.camera = { x: x + (now.x - x) * part, y: y + (now.y - y) * part, zoom };
    this.stale = true;
  }

  pan(dx, dy) { // css pixels
    const scale = this.map[2] / this.ratio, size = this.scene.size;
    const now = this.camera ?? { x: size[0] / 2, y: size[1] / 2, zoom: 1 };
    this.camera = { ...now, x: now.x - dx / scale, y: now.y + dy / scale };
    this.stale = true;
  }

  home() { this.camera = null; this.stale = true; }

  grow(rows) {
    if (rows <= this.room) return;
    this.room = Math.ceil(1.5 * rows);
    this.place = new Float32Array(4 * this.room);
    this.tint = new Uint8Array(4 * this.room);
  }

  show(frame, next = null, share = 0) {
    Object.assign(this, { frame, next: next && next.roster === frame.roster && next.scene.size.every((s, k) => s === frame.scene.size[k]) ? next : null, share });
    this.stale = true;
  }

  // Places between two frames [m], and which discs are there; in arrays that the next call fills again.
  now() {
    const a = this.frame, b = this.next, n = a.x.length, t = b ? this.share : 0;
    const [low_x, low_y, high_x, high_y] = a.scene.box, sx = (high_x - low_x) / style.last, sy = (high_y - low_y) / style.last;
    const around = [0, 1].map(k => a.scene.periodic[k] ? a.scene.size[k] / (k ? sy : sx) : 0);
    if (!this.x || this.x.length < n) [this.x, this.y, this.turn] = [0, 1, 2].map(() => new Float32Array(Math.ceil(1.5 * n)));
    const { x, y, turn } = this;
    for (let k = 0; k < n; k++) {
      let dx = 0, dy = 0, turned = 0;
      if (b && !((a.flags[k] | b.flags[k]) & style.bits.absent)) {
        dx = b.x[k] - a.x[k];
        dy = b.y[k] - a.y[k];
        turned = (b.angle[k] - a.angle[k]) << 24 >> 24;
        if (around[0]) dx -= around[0] * Math.round(dx / around[0]);
        if (around[1]) dy -= around[1] * Math.round(dy / around[1]);
      }
      x[k] = low_x + (a.x[k] + t * dx) * sx;
      y[k] = low_y + (a.y[k] + t * dy) * sy;
      turn[k] = (a.angle[k] + t * turned) * Math.PI / 128;
    }
    return n;
  }

  colours() { // of a view: its map, or null where discs have their own
    const { color, chains } = this.look, frame = this.frame;
    if (chains || color === "kind") return null;
    if (color === "rotation") return [maps.rotation, frame.angle];
    const values = frame.shades[color];
    if (!values) return null;
    return [color === "energy" ? blend(...frame.scene.colours) : maps[color], values];
  }

  listDiscs(n) {
    const { frame, x, y, turn, look } = this, { roster, scene, flags } = frame, coloured = this.colours();
    const absent = style.bits.absent, asleep = style.bits.asleep, bars = look.bonds && frame.bonds && !look.chains;
    const spokes = (style.spoked.includes(look.color) || !coloured) && !look.chains && !bars;
    const alone = roster.alone ??= roster.disc.map((disc, k) => disc === 0 && !(roster.disc[k + 1] > 0));
    const [wide, high] = scene.size;
    let rows = 0;
    const copies = scene.periodic[0] || scene.periodic[1] ? 4 : 1;
    this.grow(copies * n);
    const { place, tint } = this;
    const put = (k, px, py) => {
      const to = 4 * rows++;
      place[to] = px;
      place[to + 1] = py;
      place[to + 2] = roster.radius[k] * style.shown;
      place[to + 3] = turn[k];
      let r, g, b;
      if (roster.fixed[k]) [r, g, b] = FIXED;
      else if (look.chains) [r, g, b] = DIM;
      else if (coloured) {
        const at = 3 * coloured[1][k];
        r = coloured[0][at]; g = coloured[0][at + 1]; b = coloured[0][at + 2];
      } else { r = roster.tone[3 * k]; g = roster.tone[3 * k + 1]; b = roster.tone[3 * k + 2]; }
      if (flags[k] & asleep && look.asleep && !look.chains && !roster.fixed[k]) { // 60 % of its saturation, 80 % of its lightness
        const grey = (77 * r + 150 * g + 29 * b) / 256;
        r = 0.8 * (grey + 0.6 * (r - grey)); g = 0.8 * (grey + 0.6 * (g - grey)); b = 0.8 * (grey + 0.6 * (b - grey));
      }
      tint[to] = r; tint[to + 1] = g; tint[to + 2] = b;
      tint[to + 3] = spokes && alone[k] && !roster.fixed[k] ? 255 : 0;
    };
    for (let k = 0; k < n; k++) {
      if (flags[k] & absent) continue;
      put(k, x[k], y[k]);
      if (copies === 1) continue;
      const r = roster.radius[k];
      const across = scene.periodic[0] ? x[k] < r ? wide : x[k] > wide - r ? -wide : 0 : 0;
      const up = scene.periodic[1] ? y[k] < r ? high : y[k] > high - r ? -high : 0 : 0;
      if (across) put(k, x[k] + across, y[k]);
      if (up) put(k, x[k], y[k] + up);
      if (across && up) put(k, x[k] + across, y[k] + up);
    }
    return rows;
  }

  line(ax, ay, bx, by, width, colour, alpha = 1) {
    const k = this.lineCount++;
    if (k >= this.lineWidth.length) {
      const larger = (old, Kind) => { const fresh = new Kind(2 * old.length); fresh.set(old); return fresh; };
      this.linePlace = larger(this.linePlace, Float32Array);
      this.lineTint = larger(this.lineTint, Uint8Array);
      this.lineWidth = larger(this.lineWidth, Float32Array);
    }
    this.linePlace.set([ax, ay, bx, by], 4 * k);
    this.lineTint.set([...colour, 255 * alpha], 4 * k);
    this.lineWidth[k] = width;
  }

  listChains(scale) {
    const { frame, x, y } = this, { chains, roster, scene } = frame;
    if (!chains) return;
    const enlarged = scale * scene.size[0] / style.width, grain = scene.diameter * scale, [thin, wide, least, most] = style.chain;
    const low = thin * enlarged, high = Math.min(Math.max(wide * enlarged, least * grain), most * grain);
    const order = chains.order ??= Uint32Array.from(chains.level.keys()).sort((a, b) => chains.level[a] - chains.level[b]);
    for (const k of order) {
      const i = chains.first[k], j = chains.second[k], level = chains.level[k];
      const colour = maps.chains.subarray(3 * level, 3 * level + 3), width = low + (high - low) * level / 255;
      if (j < 0) {
        const way = chains.way[k] * Math.PI / 128, r = roster.radius[i];
        this.line(x[i], y[i], x[i] + r * Math.cos(way), y[i] + r * Math.sin(way), width, colour);
      } else this.between(x[i], y[i], x[j], y[j], width, colour);
    }
  }

  between(ax, ay, bx, by, width, colour) { // from both sides over a periodic edge
    const [wide, high] = this.scene.size, [across, up] = this.scene.periodic;
    const dx = across ? wide * Math.round((bx - ax) / wide) : 0, dy = up ? high * Math.round((by - ay) / high) : 0;
    this.line(ax, ay, bx - dx, by - dy, width, colour);
    if (dx || dy) this.line(bx, by, ax + dx, ay + dy, width, colour);
  }

  listBonds(scale) {
    const { frame, x, y } = this, { roster, bonds, scene, flags } = frame;
    const middle = new Map();
    for (let k = 0; k < roster.grain.length; k++) { // of the discs of a grain
      if (flags[k] & style.bits.absent) continue;
      const old = middle.get(roster.grain[k]);
      if (old) { old[0] += x[k]; old[1] += y[k]; old[2]++; } else middle.set(roster.grain[k], [x[k], y[k], 1]);
    }
    const width = Math.max(1, style.bar * scene.diameter * scale);
    for (let k = 0; k < bonds.length; k += 2) {
      const a = middle.get(bonds[k]), b = middle.get(bonds[k + 1]);
      if (a && b) this.between(a[0] / a[2], a[1] / a[2], b[0] / b[2], b[1] / b[2], width, BOND);
    }
  }

  listWalls(scale) {
    const { walls, scene } = this.frame, width = Math.max(1, style.wall * scale * scene.size[0] / style.width);
    for (let k = 0; k < walls.length; k += 4) this.line(walls[k], walls[k + 1], walls[k + 2], walls[k + 3], width, FIXED);
    const [wide, high] = scene.size, inset = width / 2 / scale;
    const sides = [[inset, 0, inset, high], [wide - inset, 0, wide - inset, high], [0, inset, wide, inset], [0, high - inset, wide, high - inset]];
    sides.forEach((side, k) => { if (scene.edges[k]) this.line(...side, width, FIXED); });
  }

  draw() {
    if (!this.stale || !this.frame) return false;
    this.stale = false;
    const { frame, look, paint } = this, map = this.map, n = this.now();
    paint.clear();
    if (frame.water) paint.water(map, frame.scene.size, frame.water, style.wet[0]);
    paint.discs(map, this.listDiscs(n), this.place, this.tint);
    if (frame.water) paint.water(map, frame.scene.size, frame.water, style.wet[1]);
    this.lineCount = 0;
    if (look.chains) this.listChains(map[2]);
    else if (look.bonds && frame.bonds) this.listBonds(map[2]);
    this.listWalls(map[2]);
    for (const line of this.extra) this.line(...line);
    paint.lines(map, this.lineCount, this.linePlace, this.lineTint, this.lineWidth);
    return true;
  }

  under([px, py]) { // the disc at a point, or -1
    const { frame, x, y } = this, { roster, flags } = frame;
    for (let k = frame.x.length - 1; k >= 0; k--) {
      if (!(flags[k] & style.bits.absent) && (x[k] - px) ** 2 + (y[k] - py) ** 2 < roster.radius[k] ** 2) return k;
    }
    return -1;
  }

  about(k) { // what there is to say of a disc
    const { frame, next, x, y } = this, { roster, scene } = frame, lines = [];
    lines.push(`grain ${roster.grain[k]} · ${scene.kinds[roster.kind[k]] ?? "added"}${roster.fixed[k] ? " · fixed" : ""}`);
    lines.push(`radius ${number(1e3 * roster.radius[k])} mm at ${number(x[k])}, ${number(y[k])} m`);
    if (next) {
      const [low_x, low_y, high_x, high_y] = scene.box, time = next.time - frame.time;
      const vx = (next.x[k] - frame.x[k]) * (high_x - low_x) / style.last / time, vy = (next.y[k] - frame.y[k]) * (high_y - low_y) / style.last / time;
      if (time > 0) lines.push(`velocity ${number(vx)}, ${number(vy)} m/s`);
    }
    for (const [name, values] of Object.entries(frame.shades)) {
      const top = frame.tops[name];
      if (top !== undefined && !roster.fixed[k]) lines.push(`${name} ${values[k] === 255 ? "≥ " : ""}${number(values[k] / 255 * top)} ${style.units[name] ?? ""}`.trimEnd());
    }
    if (frame.flags[k] & style.bits.asleep) lines.push("asleep");
    return lines.join("\n");
  }

  labels() { // title, facts, colours, scale
    const { scene, frame, next, look } = this, [, , scale] = this.map, time = frame.time + (next ? this.share * (next.time - frame.time) : 0);
    const write = (id, text) => { if ($(id).textContent !== text) $(id).textContent = text; };
    write("title", scene.title);
    write("facts", `t = ${time.toFixed(2)} s  ·  ${frame.grains} grain${frame.grains === 1 ? "" : "s"}  ·  ${scene.facts}`);
    const name = look.chains ? "chains" : look.color, top = look.chains ? frame.chains?.top : name === "rotation" ? 1 : frame.tops[name], legend = $("legend");
    legend.hidden = top === undefined || name === "kind";
    if (!legend.hidden) {
      const map = name === "energy" ? blend(...scene.colours) : maps[name], stops = Array.from({ length: 17 }, (_, k) => 3 * Math.round(255 * k / 16));
      legend.children[0].textContent = look.chains ? "contact force" : name;
      legend.children[2].style.background = `linear-gradient(to right, ${stops.map(k => `rgb(${map[k]},${map[k + 1]},${map[k + 2]})`).join()})`;
      legend.children[3].textContent = `${number(top)} ${style.units[name] ?? ""}`.trimEnd();
    }
    const longest = 0.12 * this.canvas.width / scale, power = 10 ** Math.floor(Math.log10(longest)), length = [5, 2, 1].find(k => k * power <= longest * (1 + 1e-9)) * power;
    const unit = [["km", 1e3], ["m", 1], ["cm", 1e-2], ["mm", 1e-3]].find(([, size]) => length >= size * (1 - 1e-9)) ?? ["mm", 1e-3];
    write("scale", `${Number((length / unit[1]).toPrecision(4))} ${unit[0]}`);
    $("scale").style.width = `${length * scale / this.ratio}px`;
  }
}

// What both have: pointers and wheel

class Hand {
  constructor(picture, owner) {
    Object.assign(this, { picture, owner, down: new Map(), last: null });
    const canvas = picture.canvas, on = (name, act, options) => canvas.addEventListener(name, act.bind(this), options);
    on("pointerdown", this.press);
    on("pointermove", this.move);
    on("pointerup", this.release);
    on("pointercancel", this.release);
    on("pointerleave", () => { this.last = null; owner.hover(null); });
    on("wheel", this.wheel, { passive: false });
    on("contextmenu", event => event.preventDefault());
    on("dblclick", event => { if (!owner.press) picture.home(); });
  }

  press(event) {
    const { picture, owner, down } = this;
    picture.canvas.focus({ preventScroll: true });
    picture.canvas.setPointerCapture(event.pointerId);
    down.set(event.pointerId, { x: event.clientX, y: event.clientY });
    this.last = event;
    if (down.size === 2 && this.tool) owner.cancel(picture.point(event)); // two fingers pan and zoom
    this.tool = down.size === 1 && owner.press && event.button !== 1 && picture.frame;
    if (this.tool) owner.press(picture.point(event), event.button === 2);
    event.preventDefault();
  }

  move(event) {
    const { picture, owner, down } = this, old = down.get(event.pointerId);
    this.last = event;
    if (!picture.frame) return;
    if (old && !this.tool) {
      const [one, other] = [...down.values()];
      const before = other ? Math.hypot(one.x - other.x, one.y - other.y) : 0;
      picture.pan((event.clientX - old.x) / down.size, (event.clientY - old.y) / down.size);
      old.x = event.clientX;
      old.y = event.clientY;
      if (other && before) {
        const middle = { clientX: (one.x + other.x) / 2, clientY: (one.y + other.y) / 2 };
        picture.zoom(Math.hypot(one.x - other.x, one.y - other.y) / before, middle);
      }
    }
    owner.hover(event, old && this.tool);
  }

  release(event) {
    const { picture, owner, down } = this;
    if (!down.delete(event.pointerId)) return;
    if (this.tool && down.size === 0) owner.release(picture.point(event));
    if (down.size === 0) this.tool = false;
  }

  wheel(event) {
    event.preventDefault();
    const notches = -Math.sign(event.deltaY || event.deltaX);
    if (event.shiftKey && this.owner.size) this.owner.size(notches);
    else this.picture.zoom(1.15 ** notches, event);
  }
}

function tip(picture, event) {
  const box = $("tip"), k = event && picture.frame ? picture.under(picture.point(event)) : -1;
  box.hidden = k < 0;
  if (k < 0) return;
  box.textContent = picture.about(k);
  const stage = $("stage").getBoundingClientRect(), x = event.clientX - stage.left, y = event.clientY - stage.top;
  box.style.left = `${x + 16 + box.offsetWidth > stage.width ? x - box.offsetWidth - 12 : x + 16}px`;
  box.style.top = `${Math.max(0, Math.min(y + 12, stage.height - box.offsetHeight))}px`;
}

const toggle = (text, on, act, extra = {}) => make("button", { type: "button", ariaPressed: String(on), onclick: act, ...extra }, text);

function plot(canvas, x, y, at, label) {
  const ratio = devicePixelRatio || 1, pen = canvas.getContext("2d"), { clientWidth: wide, clientHeight: high } = canvas;
  canvas.width = wide * ratio;
  canvas.height = high * ratio;
  pen.scale(ratio, ratio);
  const low = Math.min(0, ...y), top = Math.max(...y, low + 1e-30), left = x[0], span = x[x.length - 1] - left || 1;
  const px = v => (v - left) / span * (wide - 8) + 4, py = v => high - 6 - (v - low) / (top - low) * (high - 24);
  pen.strokeStyle = "#F2A65A";
  pen.lineWidth = 1.3;
  pen.beginPath();
  y.forEach((v, k) => pen.lineTo(px(x[k]), py(v)));
  pen.stroke();
  if (at !== null) {
    pen.strokeStyle = "#9AA3AD80";
    pen.beginPath();
    pen.moveTo(px(at), 0);
    pen.lineTo(px(at), high);
    pen.stroke();
  }
  pen.fillStyle = "#9AA3AD";
  pen.font = `${0.8 * parseFloat(getComputedStyle(document.documentElement).fontSize)}px sans-serif`;
  pen.fillText(label, 6, 13);
}

// A film that is in this page

const GROUPS_KEPT = 6;
const PLOTS = [["kinetic_energy_J", "kinetic energy [J]"], ["floor_force_N", "force on the floor [N]"], ["overlap_p99", "overlap, 99th percentile [d]"]];
const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 4];

function inflate(element) {
  const text = atob(element.textContent), packed = Uint8Array.from({ length: text.length }, (_, at) => text.charCodeAt(at));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

class Film {
  constructor() {
    const tail = json("tail");
    Object.assign(this, { tail, groups: [...document.getElementsByClassName("group")], spans: tail.groups, kept: new Map(), rosters: [], playing: false, speed: 1 });
    this.at = this.from = this.spans[0][0];
    this.to = this.spans[this.spans.length - 1][1];
    this.picture = new Picture($("canvas"));
    this.picture.look.color = head.view === "photoelastic" ? "kind" : head.view;
    this.picture.look.chains = head.chains;
    this.hand = new Hand(this.picture, this);
    this.first = [];
    this.spans.reduce((count, span) => { this.first.push(count); return count + span[2]; }, 0);
    this.build();
    addEventListener("keydown", event => this.key(event));
    addEventListener("hashchange", () => this.link());
    this.link();
    requestAnimationFrame(time => this.tick(time));
  }

  link() { // #t=2.5&view=speed
    const asked = new URLSearchParams(location.hash.slice(1));
    if (asked.has("view")) this.view(asked.get("view"));
    if (asked.has("t") && Number.isFinite(Number(asked.get("t")))) this.seek(Number(asked.get("t")));
    else if (!asked.has("t")) this.play(true);
  }

  note() {
    const color = this.picture.look.chains ? "chains" : this.picture.look.color;
    try { history.replaceState(null, "", `#t=${Number(this.at.toFixed(3))}${color === head.view ? "" : `&view=${color}`}`); } catch { /* not allowed from here */ }
  }

  roster(k) {
    return this.rosters[k] ??= inflate(document.getElementsByClassName("roster")[k]).then(buffer => rosterOf(unpack(buffer)[1]));
  }

  async group(k) {
    if (!this.kept.has(k)) {
      this.kept.set(k, inflate(this.groups[k]).then(buffer => groupOf(buffer, at => this.roster(at))));
      const far = [...this.kept.keys()].sort((a, b) => Math.abs(b - k) - Math.abs(a - k));
      while (this.kept.size > GROUPS_KEPT) this.kept.delete(far.shift());
    }
    return this.kept.get(k);
  }

  async show() { // this.at
    if (this.busy) { this.again = true; return; }
    this.busy = true;
    do {
      this.again = false;
      const at = this.at, k = Math.max(0, this.spans.findLastIndex(span => span[0] <= at + 1e-6));
      const frames = await this.group(k), f = Math.max(0, frames.findLastIndex(frame => frame.at <= at + 1e-6)), frame = frames[f];
      let next = frames[f + 1];
      if (!next && k + 1 < this.spans.length) {
        [next] = await this.group(k + 1);
      }
      this.number = this.first[k] + f;
      const share = next ? Math.min(1, Math.max(0, (at - frame.at) / (next.at - frame.at || 1))) : 0;
      this.picture.show(frame, next, share < 1e-3 ? 0 : share);
      if (f > frames.length / 2 && k + 1 < this.spans.length) this.group(k + 1);
    } while (this.again);
    this.busy = false;
    this.fresh = true;
  }

  seek(at) {
    this.play(false);
    this.at = Math.min(this.to, Math.max(this.from, at));
    this.show();
  }

  play(on) {
    if (on && this.at >= this.to) this.at = this.from;
    this.playing = on;
    this.last = null;
    if (this.button) {
      this.button.textContent = on ? "❚❚" : "▶";
      this.button.setAttribute("aria-label", on ? "pause" : "play");
    }
    this.show();
  }

  view(name) {
    const look = this.picture.look;
    if (name === "chains") look.chains = true;
    else if (head.scene.views.includes(name)) { look.chains = false; look.color = name; }
    this.picture.stale = true;
    this.press_views?.();
  }

  build() {
    this.button = make("button", { type: "button", onclick: () => { this.play(!this.playing); this.note(); } }, "▶");
    this.slider = make("input", { type: "range", min: this.from, max: this.to, step: "any", value: this.at, ariaLabel: "time", oninput: () => this.seek(Number(this.slider.value)), onchange: () => this.note() });
    this.clock = make("output", { ariaLabel: "time shown" });
    const speeds = make("select", { ariaLabel: "speed", title: "speed", onchange: () => { this.speed = Number(speeds.value); } },
      ...SPEEDS.map(speed => make("option", { value: speed, selected: speed === 1 }, `${speed}×`)));
    this.speeds = speeds;
    $("bar").append(this.button, this.slider, this.clock, speeds, make("button", { type: "button", title: "the whole picture (Home)", ariaLabel: "the whole picture", onclick: () => this.picture.home() }, "⤢"));
    const panel = $("panel"), row = make("div", { className: "row", role: "group", ariaLabel: "views" }), look = this.picture.look;
    const names = [...head.scene.views.filter(name => ["kind", "rotation", head.view, "speed", "force", "order", "temperature", "moisture"].includes(name)), "chains"];
    row.append(...names.map(name => toggle(name, false, () => { this.view(name); this.note(); })));
    this.press_views = () => [...row.children].forEach((button, k) => button.setAttribute("aria-pressed", String(names[k] === (look.chains ? "chains" : look.color))));
    this.names = names;
    this.press_views();
    this.numbers = make("div");
    this.plots = PLOTS.filter(([key]) => this.tail.series[key]).map(([key, label]) => [make("canvas", { className: "plot", role: "img", ariaLabel: `${label} over time` }), this.tail.series[key], label]);
    const report = Object.entries(this.tail.report).filter(([, value]) => typeof value !== "object" || Array.isArray(value));
    const text = value => Array.isArray(value) ? value.map(text).join(", ") || "–" : typeof value === "number" ? number(value) : String(value ?? "–");
    panel.append(make("h2", {}, "view"), row, make("h2", {}, "numbers"), this.numbers, ...this.plots.map(([canvas]) => canvas),
      ...(head.scene.about ? [make("h2", {}, "about"), make("p", { className: "note" }, head.scene.about)] : []),
      make("details", {}, make("summary", {}, "report of the end"), make("table", {}, make("tbody", {}, ...report.map(([key, value]) => make("tr", {}, make("td", {}, key), make("td", {}, text(value))))))),
      make("p", { className: "note" }, "space plays, ← → a frame, v colours, c force chains, wheel or two fingers zoom, Home the whole. A link that ends in #t=2.5 opens at that time."));
    for (const [canvas, , label] of this.plots) canvas.onclick = event => { this.seek(this.from + event.offsetX / canvas.clientWidth * (this.to - this.from)); this.note(); void label; };
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || (event.target.matches?.("select") && event.key !== " ")) return;
    const step = (this.to - this.from) / Math.max(1, this.tail.series.at.length - 1), look = this.picture.look;
    const act = {
      " ": () => this.play(!this.playing), ArrowLeft: () => this.seek(this.at - step), ArrowRight: () => this.seek(this.at + step), Home: () => this.picture.home(),
      v: () => this.view(this.names[(this.names.indexOf(look.chains ? "chains" : look.color) + 1) % this.names.length]),
      c: () => this.view(look.chains ? "kind" : "chains"), "+": () => this.picture.zoom(1.25), "-": () => this.picture.zoom(0.8),
    }[event.key];
    if (!act || (event.key === " " && event.target.matches?.("button, summary"))) return;
    event.preventDefault();
    act();
    if (event.key !== " " || !this.playing) this.note();
  }

  hover(event) { this.pointed = event; this.fresh = true; }

  tick(time) {
    requestAnimationFrame(now => this.tick(now));
    if (this.playing) {
      if (this.last !== null) this.at += Math.min(0.1, (time - this.last) / 1000) * this.speed;
      this.last = time;
      if (this.at >= this.to) { this.at = this.to; this.play(false); this.note(); }
      this.show();
    }
    const drawn = this.picture.draw();
    if (!this.picture.frame || !(drawn || this.fresh)) return;
    this.fresh = false;
    this.picture.labels();
    if (document.activeElement !== this.slider || this.playing) this.slider.value = this.at;
    this.clock.textContent = `${this.at.toFixed(2)} / ${this.to.toFixed(2)} s`;
    tip(this.picture, this.pointed);
    if (!this.shown || time - this.shown > 100 || !this.playing) {
      this.shown = time;
      const series = this.tail.series, k = this.number;
      const rows = Object.keys(series).filter(name => !["at"].includes(name)).map(name => make("div", { className: "pair" }, make("span", {}, name), make("span", {}, number(series[name][k]))));
      this.numbers.replaceChildren(...rows);
      for (const [canvas, values, label] of this.plots) plot(canvas, series.at, values, this.at, label);
    }
  }
}

if (head.kind === "film") window.sand = new Film();
