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
const TEXT = [230, 232, 235], ACCENT = [242, 166, 90], VELOCITY = [111, 195, 255], FORCE = [255, 154, 60], GOOD = [123, 196, 127], GRID = [52, 58, 68];

function blend(cold, hot) { // as light is mixed; see palette.blend_map
  const ends = [cold, hot].map(end => rgb(end).map(c => (c / 255) ** 2.2));
  return Uint8Array.from({ length: 768 }, (_, k) => 255 * (ends[0][k % 3] + (ends[1][k % 3] - ends[0][k % 3]) * Math.floor(k / 3) / 255) ** (1 / 2.2) + 0.5);
}

const pack = (colour, at = 0) => colour[at] | colour[at + 1] << 8 | colour[at + 2] << 16;

function sleepy(packed) { // at 60 % of its saturation and 80 % of its lightness
  const colour = [0, 8, 16].map(shift => packed >> shift & 255), grey = (77 * colour[0] + 150 * colour[1] + 29 * colour[2]) / 256;
  return pack(colour.map(c => 0.8 * (grey + 0.6 * (c - grey)) + 0.5));
}

function lighter(packed, factor) {
  return pack([0, 8, 16].map(shift => Math.min(255, (packed >> shift & 255) * factor + 0.5)));
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

// Discs are a triangle each, lines two, numbered by gl_VertexID, and what is known of each is a texel: instances would be drawn one by one
// where the CPU does the work of a GPU, at 20 µs each.
const ACROSS = 1024;
const shape = corners => `#version 300 es
  precision highp float; precision highp int;
  uniform highp sampler2D places; uniform highp sampler2D tints; uniform vec3 map; uniform vec2 half_size;
  ivec2 texel() { int shape = gl_VertexID / ${corners}; return ivec2(shape % ${ACROSS}, shape / ${ACROSS}); }
  vec2 corner() { int k = gl_VertexID % 6; return vec2(k == 1 || k == 2 || k == 4 ? 1.0 : -1.0, k == 2 || k == 4 || k == 5 ? 1.0 : -1.0); }
  vec4 clip(vec2 pixel) { return vec4(pixel / half_size - 1.0, 0.0, 1.0); }
`;
const DISC = [`${shape(3)}
  out vec2 at; flat out vec3 colour; flat out vec4 form;
  void main() {
    vec4 place = texelFetch(places, texel(), 0), tint = texelFetch(tints, texel(), 0);
    float radius = place.z * map.z, shown = max(radius, 1.0);
    int k = gl_VertexID % 3; // about a circle
    at = (k == 0 ? vec2(0.0, 2.0) : vec2(k == 1 ? -1.7321 : 1.7321, -1.0)) * (shown + 0.75);
    colour = tint.rgb; form = vec4(radius, shown, place.w, tint.a);
    gl_Position = clip(place.xy * map.z + map.xy + at);
  }`, `#version 300 es
  precision highp float; in vec2 at; flat in vec3 colour; flat in vec4 form; uniform float spoke[5]; out vec4 painted;
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
const LINE = [`${shape(6)}
  uniform highp sampler2D widths; out vec2 at; flat out vec4 colour; flat out vec2 form;
  void main() {
    vec4 place = texelFetch(places, texel(), 0), tint = texelFetch(tints, texel(), 0);
    float width = texelFetch(widths, texel(), 0).r;
    vec2 a = place.xy * map.z + map.xy, b = place.zw * map.z + map.xy, way = b - a;
    float size = length(way), pad = 0.5 * max(width, 1.0) + 0.5;
    vec2 along = size > 1e-6 ? way / size : vec2(1.0, 0.0), side = vec2(-along.y, along.x);
    at = vec2(corner().x > 0.0 ? size + pad : -pad, corner().y * pad);
    colour = vec4(tint.rgb, tint.a * min(width, 1.0)); form = vec2(size, pad);
    gl_Position = clip(a + along * at.x + side * at.y);
  }`, `#version 300 es
  precision highp float; in vec2 at; flat in vec4 colour; flat in vec2 form; out vec4 painted;
  void main() {
    float away = length(vec2(at.x - clamp(at.x, 0.0, form.x), at.y)), cover = clamp(form.y - away, 0.0, 1.0);
    if (cover <= 0.0) discard;
    painted = vec4(colour.rgb, colour.a * cover);
  }`];
const WATER = [`${shape(6)}
  uniform vec2 size; out vec2 at;
  void main() { at = 0.5 * corner() + 0.5; gl_Position = clip(at * size * map.z + map.xy); }`, `#version 300 es
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
    this.disc = this.program(DISC, ["places", "tints"]);
    this.line = this.program(LINE, ["places", "tints", "widths"]);
    this.wet = this.program(WATER, ["wet", "deep"]);
    gl.bindVertexArray(gl.createVertexArray());
    gl.useProgram(this.disc.program);
    gl.uniform1fv(this.disc.at("spoke"), style.spoke);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    this.formats = { 16: [gl.RGBA32F, gl.RGBA, gl.FLOAT, 4], 4: [gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, 4], 5: [gl.R32F, gl.RED, gl.FLOAT, 1] };
  }

  program(sources, names) {
    const gl = this.gl, program = gl.createProgram(), known = {};
    sources.forEach((source, k) => {
      const shader = gl.createShader(k ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    });
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? "no shaders");
    const one = { program, textures: names.map(() => ({ texture: gl.createTexture(), rows: 0 })), at: name => known[name] ??= gl.getUniformLocation(program, name) };
    gl.useProgram(program);
    names.forEach((name, k) => gl.uniform1i(one.at(name), k));
    return one;
  }

  use(one, map) {
    const gl = this.gl;
    gl.useProgram(one.program);
    gl.uniform3f(one.at("map"), ...map);
    gl.uniform2f(one.at("half_size"), this.canvas.width / 2, this.canvas.height / 2);
  }

  // What is known of `count` shapes, in textures ACROSS wide; columns have room for whole rows of them.
  many(one, corners, map, count, ...columns) {
    if (!count) return;
    const gl = this.gl, rows = Math.ceil(count / ACROSS);
    this.use(one, map);
    columns.forEach((column, k) => {
      const [format, channels, type, size] = this.formats[k === 2 ? 5 : column.BYTES_PER_ELEMENT * 4], known = one.textures[k];
      gl.activeTexture(gl.TEXTURE0 + k);
      gl.bindTexture(gl.TEXTURE_2D, known.texture);
      if (known.rows < rows) {
        known.rows = Math.ceil(1.5 * rows);
        gl.texImage2D(gl.TEXTURE_2D, 0, format, ACROSS, known.rows, 0, channels, type, null);
        for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
      }
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, ACROSS, rows, channels, type, column.subarray(0, rows * ACROSS * size));
    });
    gl.drawArrays(gl.TRIANGLES, 0, corners * count);
  }

  clear() {
    const gl = this.gl;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(...GROUND.map(c => c / 255), 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
  }

  discs(map, count, place, tint) { this.many(this.disc, 3, map, count, place, tint); }

  lines(map, count, place, tint, width) { this.many(this.line, 6, map, count, place, tint, width); }

  water(map, size, water, strength) {
    const gl = this.gl, { columns, rows } = water;
    this.use(this.wet, map);
    const pixels = water.pixels ??= woven(water.level, water.foam, water.shade);
    [[0, columns, rows, pixels], [1, 256, 1, maps.water]].forEach(([unit, wide, high, data]) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, this.wet.textures[unit].texture);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, wide, high, 0, gl.RGB, gl.UNSIGNED_BYTE, data);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
      for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    });
    gl.uniform2f(this.wet.at("nodes"), columns, rows);
    gl.uniform2f(this.wet.at("size"), ...size);
    gl.uniform2f(this.wet.at("levels"), ...style.levels);
    gl.uniform3f(this.wet.at("foam"), ...FOAM.map(c => c / 255));
    gl.uniform1f(this.wet.at("strength"), strength);
    gl.drawArrays(gl.TRIANGLES, 0, 6);
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

  get ends() { return this.look.cold ? [this.look.cold, this.look.hot] : this.scene.colours; } // of the scale of energy

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

  begin({ window, size }) { // as a scene wants to be seen
    this.home();
    if (!window) return;
    const [x0, y0, x1, y1] = window;
    this.camera = { x: (x0 + x1) / 2, y: (y0 + y1) / 2, zoom: Math.min(size[0] / (x1 - x0), size[1] / (y1 - y0)) };
  }

  grow(rows) {
    if (rows <= this.room) return;
    this.room = ACROSS * Math.ceil(1.5 * rows / ACROSS);
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
    return [color === "energy" ? blend(...this.ends) : maps[color], values];
  }

  tints(n) { // colours of all discs, packed, by their rows: wet ones are darker; see wet.darken
    const { look, frame } = this, { roster } = frame, { wet } = frame.shades, dry = this.dryTints(n);
    if (!wet || look.chains || look.forces || style.wet_views.includes(look.color)) return dry;
    const found = this.wetted = this.wetted?.length >= n ? this.wetted : new Uint32Array(Math.ceil(1.5 * n));
    for (let k = 0; k < n; k++) found[k] = wet[k] && !roster.fixed[k] ? lighter(dry[k], 1 - style.darkness * wet[k] / 255) : dry[k];
    return found;
  }

  dryTints(n) {
    const { frame, look } = this, { roster } = frame, coloured = this.colours();
    if (!coloured) {
      const name = look.chains || look.forces ? "dim" : "own";
      return roster[name] ??= Uint32Array.from(roster.fixed, (fixed, k) => fixed ? pack(FIXED) : name === "dim" ? pack(DIM) : pack(roster.tone, 3 * k));
    }
    const [map, values] = coloured, found = this.tinted = this.tinted?.length >= n ? this.tinted : new Uint32Array(Math.ceil(1.5 * n));
    const packed = Uint32Array.from({ length: 256 }, (_, k) => pack(map, 3 * k)), fixed = pack(FIXED);
    for (let k = 0; k < n; k++) found[k] = roster.fixed[k] ? fixed : packed[values[k]];
    return found;
  }

  listDiscs(n) {
    const { frame, x, y, turn, look } = this, { roster, scene, flags } = frame, tints = this.tints(n), { absent, asleep } = style.bits;
    const bars = look.bonds && frame.bonds && !look.chains, fades = look.asleep && !look.chains && !look.forces;
    const spokes = (style.spoked.includes(look.color) || !this.colours()) && !look.chains && !bars ? 0xFF000000 : 0;
    const alone = roster.alone ??= roster.disc.map((disc, k) => disc === 0 && !(roster.disc[k + 1] > 0) && !roster.fixed[k]);
    const [wide, high] = scene.size, [around, over] = scene.periodic, radius = roster.radius, shown = style.shown;
    this.grow((around || over ? 4 : 1) * n);
    const { place, tint } = this, packed = new Uint32Array(tint.buffer);
    let rows = 0;
    for (let k = 0; k < n; k++) {
      if (flags[k] & absent) continue;
      const r = radius[k], colour = (flags[k] & asleep && fades && !roster.fixed[k] ? sleepy(tints[k]) : tints[k]) | (alone[k] ? spokes : 0);
      const across = around ? x[k] < r ? wide : x[k] > wide - r ? -wide : 0 : 0, up = over ? y[k] < r ? high : y[k] > high - r ? -high : 0 : 0;
      for (let copy = 0; copy < 4; copy++) {
        if ((copy & 1 && !across) || (copy & 2 && !up)) continue;
        const to = 4 * rows;
        place[to] = x[k] + (copy & 1 ? across : 0);
        place[to + 1] = y[k] + (copy & 2 ? up : 0);
        place[to + 2] = r * shown;
        place[to + 3] = turn[k];
        packed[rows++] = colour;
        if (!across && !up) break;
      }
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

  arrow(x, y, dx, dy, scale, colour) { // dx, dy: m
    const head = 0.28, width = 1.2 * this.ratio, tip_x = x + dx, tip_y = y + dy;
    this.line(x, y, tip_x, tip_y, width, colour);
    for (const side of [0.5, -0.5]) this.line(tip_x, tip_y, tip_x - head * dx - side * head * dy, tip_y - head * dy + side * head * dx, width, colour);
  }

  listVelocities(scale, n) { // their lengths over the 99th percentile of the speed
    const { frame, next, x, y } = this, { scene, roster, flags } = frame;
    if (!next || next.time <= frame.time) return;
    const [low_x, low_y, high_x, high_y] = scene.box, sx = (high_x - low_x) / style.last, sy = (high_y - low_y) / style.last, speeds = new Float32Array(n);
    for (let k = 0; k < n; k++) speeds[k] = Math.hypot((next.x[k] - frame.x[k]) * sx, (next.y[k] - frame.y[k]) * sy);
    const top = speeds.slice().sort()[Math.floor(0.99 * (n - 1))] || 1e-30, reach = Math.max(8 * this.ratio / scale, 2 * scene.diameter) / top;
    for (let k = 0; k < n; k++) {
      if (speeds[k] < 0.03 * top || speeds[k] > 0.4 * scene.size[0] || roster.fixed[k] || flags[k] & style.bits.absent) continue;
      const part = Math.min(1, 1.5 * top / speeds[k]) * reach;
      this.arrow(x[k], y[k], (next.x[k] - frame.x[k]) * sx * part, (next.y[k] - frame.y[k]) * sy * part, scale, VELOCITY);
    }
  }

  listForces(scale) { // two arrows a contact, apart from it
    const { frame, x, y } = this, { chains, roster, scene } = frame;
    if (!chains) return;
    const reach = 0.6 * Math.max(8 * this.ratio / scale, 2 * scene.diameter);
    for (let k = 0; k < chains.first.length; k++) {
      const i = chains.first[k], j = chains.second[k], way = chains.way[k] * Math.PI / 128, size = reach * (chains.level[k] / 255) ** (1 / 0.7);
      if (size * scale < this.ratio) continue;
      const c = j < 0 ? Math.cos(way) : (x[j] - x[i]), s = j < 0 ? Math.sin(way) : (y[j] - y[i]), far = Math.hypot(c, s) || 1, r = roster.radius[i];
      if (j >= 0 && far > 2 * (r + roster.radius[j])) continue; // over a periodic edge
      const px = x[i] + r * c / far, py = y[i] + r * s / far;
      for (const sign of [1, -1]) this.arrow(px, py, sign * size * c / far, sign * size * s / far, scale, FORCE);
    }
  }

  listGrid([columns, rows]) {
    const [wide, high] = this.scene.size;
    for (let k = 0; k <= columns; k++) this.line(k * wide / columns, 0, k * wide / columns, high, 1, GRID);
    for (let k = 0; k <= rows; k++) this.line(0, k * high / rows, wide, k * high / rows, 1, GRID);
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
    if (frame.grid) this.listGrid(frame.grid);
    if (look.velocities) this.listVelocities(map[2], n);
    if (look.forces) this.listForces(map[2]);
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
      if (name !== "wet" && top !== undefined && !roster.fixed[k]) lines.push(`${name} ${values[k] === 255 ? "≥ " : ""}${number(values[k] / 255 * top)} ${style.units[name] ?? ""}`.trimEnd());
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
      const map = name === "energy" ? blend(...this.ends) : maps[name], stops = Array.from({ length: 17 }, (_, k) => 3 * Math.round(255 * k / 16));
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

// After a click keys are for the picture again; those who go by keyboard keep their place.
addEventListener("click", event => { if (event.detail && event.target.closest?.("button, select, input[type=range]")) document.activeElement?.blur(); });

function tip(picture, event) {
  const box = $("tip"), k = event && picture.frame ? picture.under(picture.point(event)) : -1;
  box.hidden = k < 0;
  if (k < 0) return;
  box.textContent = picture.about(k);
  const stage = $("stage").getBoundingClientRect(), x = event.clientX - stage.left, y = event.clientY - stage.top;
  box.style.left = `${x + 16 + box.offsetWidth > stage.width ? x - box.offsetWidth - 12 : x + 16}px`;
  box.style.top = `${Math.max(0, Math.min(y + 12, stage.height - box.offsetHeight))}px`;
}

function circle(x, y, r, tint, width) { // lines as `extra` has them
  return Array.from({ length: 48 }, (_, k) => {
    const [a, b] = [k, k + 1].map(step => step * Math.PI / 24);
    return [x + r * Math.cos(a), y + r * Math.sin(a), x + r * Math.cos(b), y + r * Math.sin(b), width, tint];
  });
}

const toggle = (text, on, act, extra = {}) => make("button", { type: "button", ariaPressed: String(on), onclick: act, ...extra }, text);

function plot(canvas, x, y, label, along = "") {
  const ratio = devicePixelRatio || 1, pen = canvas.getContext("2d"), { clientWidth: wide, clientHeight: high } = canvas;
  canvas.width = wide * ratio;
  canvas.height = high * ratio;
  pen.scale(ratio, ratio);
  const known = y.filter(Number.isFinite), low = Math.min(0, ...known), top = Math.max(...known, low + 1e-30), left = x[0], span = x[x.length - 1] - left || 1;
  pen.strokeStyle = "#F2A65A";
  pen.lineWidth = 1.3;
  pen.beginPath();
  let down = false; // the pen: lifted over numbers that there are not
  y.forEach((v, k) => {
    const at = [(x[k] - left) / span * wide, high - 6 - (v - low) / (top - low) * (high - 24)];
    if (!Number.isFinite(v)) down = false; else if (down) pen.lineTo(...at); else { pen.moveTo(...at); down = true; }
  });
  pen.stroke();
  pen.fillStyle = "#9AA3AD";
  pen.font = `${0.8 * parseFloat(getComputedStyle(document.documentElement).fontSize)}px sans-serif`;
  pen.fillText(label, 6, 13);
  pen.textAlign = "right";
  if (along) pen.fillText(`${along} ${number(left)} … ${number(left + span)}`, wide - 6, high - 10);
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
    Object.assign(this, { tail, shown: 0, groups: [...document.getElementsByClassName("group")], spans: tail.groups, kept: new Map(), rosters: [], playing: false, speed: 1 });
    this.at = this.from = this.spans[0][0];
    this.to = this.spans[this.spans.length - 1][1];
    this.picture = new Picture($("canvas"));
    this.picture.look.color = head.view === "photoelastic" ? "kind" : head.view;
    this.picture.look.chains = head.chains;
    this.picture.begin(head.scene);
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
    this.numbers = Object.keys(this.tail.series).filter(name => name !== "at").map(name => [name, make("span")]);
    const numbers = this.numbers.map(([name, place]) => make("div", { className: "pair" }, make("span", {}, name), place));
    this.plots = PLOTS.filter(([key]) => this.tail.series[key]).map(([key, label]) => [make("div", { className: "plot" }, make("canvas", { role: "img", ariaLabel: `${label} over time` }), make("i")), this.tail.series[key], label]);
    const report = Object.entries(this.tail.report).filter(([, value]) => typeof value !== "object" || Array.isArray(value));
    const text = value => Array.isArray(value) ? value.map(text).join(", ") || "–" : typeof value === "number" ? number(value) : String(value ?? "–");
    panel.append(make("h2", {}, "view"), row, make("h2", {}, "numbers"), ...numbers, ...this.plots.map(([box]) => box),
      ...(head.scene.about ? [make("h2", {}, "about"), make("p", { className: "note" }, head.scene.about)] : []),
      make("details", {}, make("summary", {}, "report of the end"), make("table", {}, make("tbody", {}, ...report.map(([key, value]) => make("tr", {}, make("td", {}, key), make("td", {}, text(value))))))),
      make("p", { className: "note" }, "space plays, ← → a frame, v colours, c force chains, wheel or two fingers zoom, Home the whole. A link that ends in #t=2.5 opens at that time."));
    for (const [box] of this.plots) box.onclick = event => { this.seek(this.from + event.offsetX / box.clientWidth * (this.to - this.from)); this.note(); };
    new ResizeObserver(() => this.plot()).observe(panel);
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
    if (!this.picture.frame || !(drawn || this.fresh) || (this.playing && time - this.shown < 100)) return; // text changes ten times a second
    this.fresh = false;
    this.shown = time;
    this.picture.labels();
    if (document.activeElement !== this.slider || this.playing) this.slider.value = this.at;
    this.clock.textContent = `${this.at.toFixed(2)} / ${this.to.toFixed(2)} s`;
    tip(this.picture, this.pointed);
    for (const [name, place] of this.numbers) place.textContent = number(this.tail.series[name][this.number]);
    const share = (this.at - this.from) / (this.to - this.from || 1);
    for (const [box] of this.plots) box.lastChild.style.left = `${100 * share}%`;
  }

  plot() {
    for (const [box, values, label] of this.plots) plot(box.firstChild, this.tail.series.at, values, label);
  }
}


// A session that a server sends

const TRY_AGAIN = 1000, PART = 2 ** 17, HISTORY = 240;

class Live {
  constructor() {
    Object.assign(this, { state: null, table: null, gap: 16, arrived: 0, place: null, role: "", history: [], stroke: false, mode: "", ruled: null });
    this.picture = new Picture($("canvas"));
    this.picture.look.color = "kind";
    this.hand = new Hand(this.picture, this);
    $("bar").hidden = true;
    $("panel").append(make("p", { className: "note" }, "connecting …"));
    this.bars();
    addEventListener("keydown", event => this.key(event));
    this.connect();
    requestAnimationFrame(() => this.tick());
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = this.socket = new WebSocket(`${scheme}://${location.host}/socket${location.search}`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = event => { this.take(event.data); this.say("ack"); };
    socket.onclose = () => {
      this.said("the connection is lost; trying again …");
      this.role = "";
      setTimeout(() => this.connect(), TRY_AGAIN);
    };
    socket.onopen = () => this.said("");
  }

  say(...words) { if (this.socket.readyState === 1) this.socket.send(JSON.stringify(words)); }
  do(...action) { this.say("do", action); }
  said(text) { if ($("said").textContent !== text) $("said").textContent = text; }

  take(data) {
    if (typeof data === "string") {
      const told = JSON.parse(data);
      if (told.role) { this.role = told.role; this.marks(); }
      if (told.scenes) this.bundled = told.scenes;
      if (told.panel) {
        const { title, size } = told.panel.scene, old = this.table?.scene;
        if (!old || old.title !== title || String(old.size) !== String(size)) this.picture.begin(told.panel.scene); // another scene
        this.table = told.panel;
        this.build();
      }
      if (told.wait) this.said(told.wait);
      if (told.state) this.update(told.state);
      return;
    }
    const [about, planes] = unpack(data);
    if (about.kind === "roster") { this.roster = rosterOf(planes); this.number = about.roster; }
    if (about.kind === "file") {
      const link = make("a", { href: URL.createObjectURL(new Blob([planes.data])), download: about.name });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 60000);
    }
    if (about.kind === "frame" && about.roster === this.number) this.frame(about, planes);
  }

  frame(about, planes) {
    const now = performance.now(), picture = this.picture, n = planes.x.length;
    const shades = Object.keys(planes).filter(name => name.startsWith("shade ")).map(name => [name.slice(6), planes[name]]);
    const chains = planes["chain first"] && { first: planes["chain first"], second: planes["chain second"], level: planes["chain level"], way: planes["chain way"], top: about.tops.chains };
    const water = about.water && { columns: about.water[0], rows: about.water[1], level: planes["water level"], foam: planes["water foam"], shade: planes["water shade"] };
    const frame = {
      ...about, roster: this.roster, x: planes.x, y: planes.y, angle: planes.angle, flags: planes.flags ?? (this.none?.length === n ? this.none : this.none = new Uint8Array(n)),
      walls: planes.walls, bonds: planes.bonds ?? null, chains: chains ?? null, water: water ?? null, shades: Object.fromEntries(shades),
    };
    if (this.arrived) this.gap += 0.2 * (Math.min(100, now - this.arrived) - this.gap);
    this.arrived = now;
    const last = this.newest;
    this.newest = frame;
    // From the frame before to this one, over the time in which the next one is due; at once where time went back, or another scene came.
    const follows = last && last.roster === frame.roster && frame.time >= last.time && last.scene.title === frame.scene.title;
    Object.assign(picture.look, about.look);
    if (follows) picture.show(last, frame, 0); else picture.show(frame);
    this.fresh = true;
  }

  tick() {
    requestAnimationFrame(() => this.tick());
    const picture = this.picture;
    if (!picture.frame) return;
    if (this.place && this.stroke) { this.say("move", ...this.place); this.place = null; }
    if (picture.next) {
      const share = Math.min(1, (performance.now() - this.arrived) / Math.max(8, this.gap));
      if (share !== picture.share) { picture.share = share; picture.stale = true; }
    }
    if (this.ruled?.fresh && this.stroke) { this.ruled.fresh = false; this.say("rule", ...this.ruled.line); }
    if (this.follow) this.track();
    picture.extra = [...this.overlay(), ...this.cursor()];
    if (picture.draw()) { picture.labels(); this.frames = (this.frames ?? 0) + 1; }
    if (this.fresh && !this.stroke) { this.fresh = false; if (this.pointed && this.mode === "inspect") tip(picture, this.pointed); }
  }

  disc(id) { return this.newest && this.picture.x ? this.newest.roster.grain.indexOf(id) : -1; } // row of a grain's first one

  track() { // the camera goes with a grain
    const { picture } = this, k = this.disc(this.state?.watched.grain?.id ?? -1);
    if (k < 0) return;
    const [x, y] = [picture.x[k], picture.y[k]], now = picture.camera;
    if (now && now.x === x && now.y === y) return;
    picture.camera = { x, y, zoom: now?.zoom ?? 3 };
    picture.stale = true;
  }

  overlay() { // the grain that is inspected and what presses it, the ruler, the slope that was fitted
    const { picture, state, newest } = this, lines = [], line = this.ruled?.line ?? state?.watched.line?.ends, label = $("ruler");
    if (!state || !newest) return lines;
    const { ratio } = picture, wide = 2 * ratio, grain = state.watched.grain, k = grain ? this.disc(grain.id) : -1, scale = picture.map[2];
    if (k >= 0) {
      const r = newest.roster.radius[k] + 3 * ratio / scale, most = Math.max(1e-30, ...grain.contacts.map(one => Math.hypot(...one.force)));
      lines.push(...circle(picture.x[k], picture.y[k], r, ACCENT, wide));
      const reach = Math.max(2 * newest.scene.diameter, 24 * ratio / scale) / most;
      for (const { point: [x, y], force: [fx, fy] } of grain.contacts) { // to the contact, as it is pushed
        const [dx, dy] = [fx * reach, fy * reach];
        lines.push([x - dx, y - dy, x, y, wide, FORCE]);
        for (const side of [0.5, -0.5]) lines.push([x, y, x - 0.28 * dx - side * 0.28 * dy, y - 0.28 * dy + side * 0.28 * dx, wide, FORCE]);
      }
    }
    label.hidden = !line;
    if (!line) return lines;
    const [x0, y0, x1, y1] = line, size = Math.hypot(x1 - x0, y1 - y0) || 1, tick = 7 * ratio / scale, [nx, ny] = [(y0 - y1) / size * tick, (x1 - x0) / size * tick];
    const reach = 40 * ratio / scale, turn = Math.atan2(y1 - y0, x1 - x0), flat = Math.abs(turn) > Math.PI / 2 ? Math.sign(turn) * Math.PI : 0;
    lines.push([x0, y0, x1, y1, wide, VELOCITY], [x0 - nx, y0 - ny, x0 + nx, y0 + ny, wide, VELOCITY], [x1 - nx, y1 - ny, x1 + nx, y1 + ny, wide, VELOCITY]);
    lines.push([x0, y0, x0 + 1.3 * reach * Math.cos(flat), y0, ratio, VELOCITY]); // the protractor: from the horizontal to the ruler
    for (let step = 0; step < 16; step++) {
      const [a, b] = [step, step + 1].map(one => flat + (turn - flat) * one / 16);
      lines.push([x0 + reach * Math.cos(a), y0 + reach * Math.sin(a), x0 + reach * Math.cos(b), y0 + reach * Math.sin(b), 1.4 * ratio, VELOCITY]);
    }
    const fit = state.watched.line?.fit;
    if (fit) lines.push([...fit.ends, 2.4 * ratio, GROUND], [...fit.ends, 1.6 * ratio, GOOD]);
    const [left, low] = picture.map, stage = $("stage").getBoundingClientRect();
    label.textContent = (state.watched.line?.rows ?? []).filter(([name]) => name !== "across, up").map(row => row.join(" ")).join("\n");
    label.style.left = `${Math.max(4, Math.min((x1 * scale + left) / ratio + 12, stage.width - label.offsetWidth - 6))}px`;
    label.style.top = `${Math.max(4, (picture.canvas.height - Math.max(y0, y1, fit?.ends[1] ?? 0, fit?.ends[3] ?? 0) * scale - low) / ratio - label.offsetHeight - 14)}px`;
    return lines;
  }

  cursor() { // the brush, the wall that is being drawn, the string of what is held
    const { picture, state, newest } = this, lines = [];
    if (!state || !this.pointed) return lines;
    if (this.mode) return lines;
    const [x, y] = picture.point(this.pointed), colour = this.stroke ? ACCENT : [154, 163, 173];
    const rim = [...circle(x, y, state.size, GROUND, 3.4 * picture.ratio), ...circle(x, y, state.size, colour, 1.4 * picture.ratio)];
    const path = [...(this.stroke && newest?.path || []), [x, y]];
    for (let k = 1; k < path.length; k++) lines.push([...path[k - 1], ...path[k], 2 * picture.ratio, ACCENT]);
    if (this.stroke && newest?.held != null) {
      const k = newest.roster.grain.indexOf(newest.held);
      if (k >= 0 && picture.x) lines.push([picture.x[k], picture.y[k], x, y, 1.4 * picture.ratio, TEXT]);
    }
    return [...rim, ...lines];
  }

  // the hand

  press(place, other) {
    this.stroke = true;
    if (this.mode === "inspect") {
      const k = this.picture.under(place);
      this.say("inspect", k < 0 ? -1 : this.picture.frame.roster.grain[k]);
    } else if (this.mode === "ruler") this.ruled = { line: [...place, ...place] };
    else this.say("press", ...place, other);
  }

  release(place) {
    this.stroke = false;
    if (this.ruled) {
      const [x0, y0] = this.ruled.line;
      if (Math.hypot(place[0] - x0, place[1] - y0) * this.picture.map[2] > 4) this.say("rule", x0, y0, ...place); else this.say("unrule");
      this.ruled = null;
    } else if (!this.mode) this.say("release", ...place);
  }

  cancel() {
    this.stroke = false;
    this.ruled = null;
    if (!this.mode) this.say("cancel");
  }

  enter(mode) { // what the hand does besides the tools: it inspects, or measures
    this.mode = this.mode === mode ? "" : mode;
    if (this.mode !== "inspect") $("tip").hidden = true;
    this.picture.stale = true;
    this.marks();
  }

  size(notches) { this.say("grow", notches); }

  hover(event, drawing) {
    this.pointed = event;
    if (event && drawing && this.ruled) this.ruled = { line: [...this.ruled.line.slice(0, 2), ...this.picture.point(event)], fresh: true };
    else if (event && drawing && !this.mode) this.place = this.picture.point(event);
    this.picture.stale = true;
    if (this.mode === "inspect" && !drawing) tip(this.picture, event); else $("tip").hidden = true;
  }

  key(event) {
    if (!this.table || event.ctrlKey || event.metaKey || event.altKey || event.target.matches?.("input:not([type=range]), select, textarea")) return;
    const name = event.key;
    if (event.target.matches?.("input") && /^(Arrow|Home|End|Page)/.test(name)) return; // the slider's own
    if (name === "Home") { this.picture.home(); event.preventDefault(); return; }
    if (name === "h") { this.help(); return; }
    const mode = { k: "inspect", "'": "ruler" }[name];
    if (mode) { this.enter(mode); event.preventDefault(); return; }
    if (name === "Escape" && this.mode) { this.enter(this.mode); return; }
    if (name === " " && event.target.matches?.("button, summary")) return;
    if (name === "Escape" || !this.table.keys.some(key => key[0] === name)) return;
    event.preventDefault();
    this.say("key", name);
  }

  // what stands beside the picture

  bars() {
    this.dialog = make("dialog", { ariaLabel: "keys" });
    this.dialog.onclick = event => { if (event.target === this.dialog) this.dialog.close(); };
    this.picker = make("input", { type: "file", accept: ".npz,.toml", hidden: true, onchange: () => this.upload() });
    document.body.append(this.dialog, this.picker);
  }

  async upload() {
    const [file] = this.picker.files;
    if (!file) return;
    this.say("upload", file.name.slice(0, 200), file.size);
    const data = await file.arrayBuffer();
    for (let at = 0; at < data.byteLength; at += PART) this.socket.send(data.slice(at, at + PART));
    this.picker.value = "";
  }

  help() {
    if (this.dialog.open) { this.dialog.close(); return; }
    const rows = [...this.table.keys, ["Home", "Home", "the whole picture; wheel or two fingers zoom, the middle button pans, shift and wheel size the brush", "views"], ["k", "k", "inspect: numbers of the grain under the pointer; a click keeps one in the panel", "views"],
      ["'", "'", "ruler: draw a line to measure its length and angle, and the slope of the surface below it", "views"]];
    this.dialog.replaceChildren(make("h2", {}, "Keys"), make("table", {}, make("tbody", {}, ...rows.map(([, name, text]) => make("tr", {}, make("td", {}, name), make("td", { style: "text-align:left" }, text))))));
    this.dialog.showModal();
  }

  scenes() {
    const buttons = (this.bundled ?? []).map(([name, title, about, picture]) => make("button", { type: "button", onclick: () => { this.dialog.close(); this.say("scene", name); } },
      picture ? make("img", { src: picture, alt: "", loading: "lazy" }) : "", make("b", {}, title), make("small", {}, about)));
    this.dialog.replaceChildren(make("h2", {}, "Scenes"), make("div", { id: "scenes" }, ...buttons));
    this.dialog.showModal();
  }

  build() {
    const { table } = this, panel = $("panel"), top = panel.scrollTop;
    const press = (text, act, title = "") => make("button", { type: "button", onclick: act, title }, text);
    const row = (label, ...buttons) => make("div", { className: "row", role: "group", ariaLabel: label }, ...buttons);
    const keyOf = Object.fromEntries(table.keys.map(key => [key[0], key]));
    const keyed = (key, text) => press(text, () => this.say("key", key), `${keyOf[key][2]} (${keyOf[key][1]})`);
    this.on = []; // [button, whether it is pressed, by state]
    const choice = (text, act, pressed, title = "", key = "") => {
      const button = press("", act, title);
      if (key) button.append(make("kbd", {}, key));
      button.append(text);
      this.on.push([button, pressed]);
      return button;
    };
    this.sliders = new Map();
    const slider = knob => {
      const value = make("button", { type: "button", title: "type a value", style: "padding:0 .2rem;min-height:0;background:none;color:var(--dim)", onclick: () => this.type(knob) });
      const input = make("input", { type: "range", min: 0, max: 1, step: "any", ariaLabel: `${knob.label} ${knob.unit}`, title: knob.help,
        onpointerdown: () => this.say("take", knob.key), onkeydown: event => { if (event.key.startsWith("Arrow")) this.say("take", knob.key); },
        ondblclick: () => this.say("default", knob.key), oninput: () => this.say("slide", knob.key, Number(input.value)) });
      this.sliders.set(knob.key, { input, value });
      return make("div", {}, make("div", { className: "pair", title: knob.help }, make("span", {}, knob.label), value), input);
    };
    const of = group => table.knobs.filter(knob => knob.group === group).map(slider);
    const tools = table.tools.map(tool => choice(tool.name, () => this.do("choose", tool.name), state => state.tool === tool.name, tool.help, tool.key));
    this.toolHelp = make("p", { className: "note" });
    this.toolSliders = of("tools");
    const kinds = table.scene.kinds;
    this.kind = make("button", { type: "button", title: "next kind of grain for create and pour (t)", onclick: () => this.say("key", "t") });
    this.accuracy = make("div");
    this.lines = make("div", { className: "note" });
    this.pause = keyed(" ", "pause");
    this.undo = keyed("z", "undo");
    this.redo = keyed("y", "redo");
    this.film = keyed("f", "film");
    this.record = press("record", () => this.say("record"), "everything that is done, for `taichi-sand render` to do again");
    this.swatches = make("div", {}, ...Object.entries(table.swatches).map(([end, colours]) => row(end, end, ...colours.map(colour => {
      const button = choice("", () => this.do("look", end, colour), state => state.look[end] === colour, `${end} ${colour}`);
      button.append(make("i", { style: `display:inline-block;width:1.2rem;height:1rem;background:${colour};border-radius:.2rem` }));
      button.ariaLabel = `${end} ${colour}`;
      return button;
    }))));
    const views = table.scene.views.map(name => choice(name, () => this.do("look", "color", name), state => state.look.color === name));
    const switches = table.switches.map(([name, text]) => choice(text, () => this.do("look", name, !this.state.look[name]), state => state.look[name]));
    const effects = table.effects.map(name => choice(name, () => this.do("effect", name, !this.state.effects.includes(name)), state => state.effects.includes(name)));
    this.effectSliders = table.knobs.filter(knob => !["accuracy", "world", "tools"].includes(knob.group)).map(slider);
    this.plots = table.plots.map(one => {
      const canvas = make("canvas", { role: "img", ariaLabel: `${one.label} ${one.along ? `over ${one.along}` : "over time"}` });
      return { ...one, canvas, box: make("div", { className: "plot" }, canvas) };
    });
    const plots = table.plots.map(({ name, label }) => choice(name, () => this.say("plot", name, !this.state.plots.includes(name)), state => state.plots.includes(name), label));
    this.grain = make("div");
    this.ruler = make("div");
    this.rewind = make("input", { type: "range", min: 0, step: 1, ariaLabel: "rewind to", oninput: () => this.when(), onchange: () => this.do("back", this.state.rewind[this.rewind.value]) });
    this.kept = make("div", { hidden: true }, make("div", { className: "pair" }, make("span", {}, "rewind to"), make("span")), this.rewind);
    panel.replaceChildren(
      row("time", this.pause, keyed(",", "▸|"), keyed("-", "slower"), keyed("=", "faster"), keyed("r", "reset"), this.undo, this.redo, choice("rewind", () => this.do("rewinding", this.state.rewind === null), state => state.rewind !== null, "keep a moment every half a second, to go back to"), press("scenes", () => this.scenes()), press("keys", () => this.help())),
      this.kept,
      make("h2", {}, "tools"), row("tools", ...tools), this.toolHelp, kinds.length > 1 ? row("kind", this.kind) : "", ...this.toolSliders,
      make("h2", {}, "view"), row("views", ...views), make("div", { style: "height:.3rem" }), row("parts", ...switches), this.swatches,
      make("h2", {}, "measure"), row("measure", choice("inspect", () => this.enter("inspect"), () => this.mode === "inspect", "numbers of the grain under the pointer; a click keeps one here", "k"),
        choice("ruler", () => this.enter("ruler"), () => this.mode === "ruler", "draw a line: its length and angle, and the slope of the surface below it", "'")), this.grain, this.ruler,
      make("h2", {}, "accuracy"), row("solver", ...["rigid", "md"].map(kind => choice(kind, () => this.do("solver", kind), state => state.solver === kind))), ...of("accuracy"), this.accuracy,
      make("h2", {}, "world"), ...of("world"), row("ranges", choice("unphysical ranges", () => this.say("key", "u"), state => state.opened, keyOf.u[2])),
      make("h2", {}, "effects"), row("effects", ...effects), make("div", { style: "height:.3rem" }), ...this.effectSliders,
      make("h2", {}, "plots"), row("plots", ...plots), make("div", { style: "height:.3rem" }), ...this.plots.map(({ box }) => box),
      make("h2", {}, "files"), row("files", keyed("s", "save"), press("load", () => this.picker.click(), "a checkpoint or a scene file"), keyed("l", "quick load"), keyed("p", "picture"), this.film, this.record, press("scene file", () => this.say("scene_file"))),
      this.lines, table.scene.about ? make("p", { className: "note" }, table.scene.about) : "");
    panel.scrollTop = top;
    if (this.state) this.update(this.state);
  }

  type(knob) {
    const old = this.state.values[knob.key][3], given = prompt(`${knob.label} [${knob.unit || "1"}]: ${knob.help}`, String(Number(old.toPrecision(6))));
    const value = Number((given ?? "").replace(",", "."));
    if (given?.trim() && Number.isFinite(value)) this.say("value", knob.key, value);
  }

  update(state) {
    this.state = state;
    this.said(state.said || "");
    if (!this.table || !this.sliders) return;
    this.picture.stale = true;
    for (const [key, { input, value }] of this.sliders) {
      const now = state.values[key];
      if (!now) continue;
      if (!(document.activeElement === input && input.matches(":active"))) input.value = now[0];
      value.textContent = now[1];
      value.classList.toggle("wrong", now[2]);
    }
    const tool = this.table.tools.find(one => one.name === state.tool);
    this.toolHelp.textContent = tool.help;
    const shown = this.table.knobs.filter(knob => knob.group === "tools");
    this.toolSliders.forEach((slider, k) => { slider.hidden = !tool.uses.includes(shown[k].key); });
    const others = this.table.knobs.filter(knob => !["accuracy", "world", "tools"].includes(knob.group));
    this.effectSliders.forEach((slider, k) => { slider.hidden = !state.effects.includes(others[k].group); });
    this.kind.textContent = `kind ${state.kind + 1} of ${this.table.scene.kinds.length}: ${this.table.scene.kinds[state.kind] ?? ""}`;
    this.swatches.hidden = state.look.color !== "energy";
    this.pause.textContent = state.paused ? "go on" : "pause";
    this.undo.disabled = !state.undo;
    this.redo.disabled = !state.redo;
    this.film.textContent = state.filming ? "end film" : "film";
    this.record.textContent = state.recording ? "end recording" : "record";
    this.accuracy.replaceChildren(...state.accuracy.map(([label, value, tone]) => make("div", { className: "pair" }, make("span", {}, label), make("span", { className: tone }, value))));
    this.lines.replaceChildren(...(state.look.hud ? state.lines : []).map(([text, tone]) => make("div", { className: tone }, text)));
    this.marks();
    this.closely(state);
    this.drawPlots(state);
  }

  when() { // the time on the slider of what can be gone back to
    const times = this.state.rewind ?? [];
    this.kept.firstChild.lastChild.textContent = `${number(times[this.rewind.value] ?? 0)} s`;
  }

  closely({ watched: { grain, line }, rewind }) { // what is inspected and measured; rewinding
    const pairs = rows => rows.map(([name, value]) => make("div", { className: "pair" }, make("span", {}, name), make("span", {}, value)));
    const shown = JSON.stringify([grain, line?.rows, this.follow]);
    if (!grain) this.follow = false;
    if (shown !== this.shown) {
      this.shown = shown;
      const follow = grain && toggle("follow", Boolean(this.follow), () => { this.follow = !this.follow; this.closely(this.state); }, { title: "the picture goes with this grain" });
      const forget = name => make("button", { type: "button", onclick: () => this.say(...name) }, "forget");
      this.grain.replaceChildren(...(grain ? [make("h2", {}, `grain ${grain.id}`), ...pairs(grain.rows),
        ...grain.contacts.map(one => make("div", { className: "note" }, `${one.with}: ${one.text}`)), make("div", { className: "row" }, follow, forget(["inspect", -1]))] : []));
      this.ruler.replaceChildren(...(line ? [make("h2", {}, "ruler"), ...pairs(line.rows), make("div", { className: "row" }, forget(["unrule"]))] : []));
    }
    this.kept.hidden = !(rewind?.length > 1);
    if (!this.kept.hidden && !this.rewind.matches(":active, :focus")) {
      this.rewind.max = rewind.length - 1;
      this.rewind.value = Math.max(0, rewind.findLastIndex(time => time <= (this.newest?.time ?? 0) + 1e-6));
      this.when();
    }
  }

  drawPlots({ time, watched, plots }) {
    const last = this.history[this.history.length - 1], now = watched.plots;
    if (last && time < last.time) this.history = [];
    if (time !== null && (!last || time !== last.time)) {
      this.history.push({ ...now, time });
      if (this.history.length > HISTORY) this.history.shift();
    }
    for (const { box, canvas, name, label, unit, along } of this.plots) {
      box.hidden = !plots.includes(name);
      const found = now[name];
      if (box.hidden || found === undefined) continue;
      const text = along ? `${label} ${unit}` : `${label}: ${number(found)} ${unit}`;
      if (along) { if (found[0].length > 1) plot(canvas, ...found, text, along); continue; }
      const known = this.history.filter(one => one[name] !== undefined);
      if (known.length > 1) plot(canvas, known.map(one => one.time), known.map(one => one[name]), text, "t [s]");
    }
  }

  marks() {
    const { state, role } = this;
    if (!state || !this.on) return;
    for (const [button, pressed] of this.on) button.setAttribute("aria-pressed", String(Boolean(pressed(state))));
    const badges = [];
    if (state.unphysical.length) badges.push(make("span", { className: "wrong" }, `UNPHYSICAL: ${state.unphysical.join(", ")}`));
    if (state.paused) badges.push(make("span", {}, "paused"));
    if (state.filming) badges.push(make("span", {}, "● filming"));
    if (state.recording) badges.push(make("span", {}, "● recording"));
    if (state.offer && role !== "watch") badges.push(make("button", { type: "button", style: "pointer-events:auto", onclick: () => this.say("help_out") }, state.offer));
    if (role === "watch") badges.push(make("span", {}, "watching: somebody else plays"));
    const text = badges.map(badge => badge.textContent).join("|");
    if (text !== this.badged) { this.badged = text; $("badges").replaceChildren(...badges); }
  }
}

window.sand = head.kind === "film" ? new Film() : new Live();
