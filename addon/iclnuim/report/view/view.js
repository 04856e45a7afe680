"use strict";
// The page's own script: unpacks what page.py packed, draws it with regl, and answers mouse, touch and keys.

const $ = (id) => document.getElementById(id);
const data = JSON.parse($("data").textContent);

// ---- unpacking -----------------------------------------------------------------------------------

function bytesOf(id) {
  const text = $(id).textContent;
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

async function inflated(id) {
  const stream = new Blob([bytesOf(id)]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Whole numbers as packing.py wrote them: differences of neighbours, zigzag, in planes of bytes.
async function wholeNumbers(id, kind) {
  const planes = await inflated(id);
  const width = kind.BYTES_PER_ELEMENT;
  const count = planes.length / width;
  const found = new kind(count);
  let sum = 0;
  for (let i = 0; i < count; i++) {
    let code = 0;
    for (let k = width - 1; k >= 0; k--) code = code * 256 + planes[k * count + i];
    sum += code & 1 ? -((code + 1) / 2) : code / 2;
    found[i] = sum;
  }
  return found;
}

async function floats(id) {
  return new Float32Array((await inflated(id)).buffer);
}

// ---- matrices (column by column) and poses [x, y, z, qx, qy, qz, qw] of the camera in the world ---------

const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const along = (a, step, b) => [a[0] + step * b[0], a[1] + step * b[1], a[2] + step * b[2]];
const unit = (a) => a.map((v) => v / (Math.hypot(...a) || 1));

function lookAt(eye, target, up) {
  const z = unit(minus(eye, target));
  const x = unit(cross(up, z));
  const y = cross(z, x);
  return [x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, -dot(x, eye), -dot(y, eye), -dot(z, eye), 1];
}

function perspective(halfHeight, aspect, near, far) {
  const f = 1 / halfHeight;
  return [f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
}

function axesOf(pose) {
  const [x, y, z, w] = pose.slice(3);
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
    [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
    [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
  ];
}

function inWorld(pose, axes, p) {
  let q = pose;
  for (let k = 0; k < 3; k++) q = along(q, p[k], axes[k]);
  return q;
}

// ---- drawing ---------------------------------------------------------------------------------------

const world = $("world");
const regl = createREGL({
  canvas: world,
  extensions: ["OES_standard_derivatives", "OES_element_index_uint", "ANGLE_instanced_arrays"],
  attributes: { antialias: true },
});
const colourMap = regl.texture({ data: data.ramp, width: data.ramp.length / 3, height: 1, format: "rgb", mag: "linear", min: "linear" });
const view = { projection: (c) => c.projection, view: (c) => c.view };

// A line as a strip of quads, `width` pixels wide.
const drawLine = regl({
  vert: `precision highp float;
    uniform mat4 projection, view; uniform vec2 size; uniform float width;
    attribute vec3 start, end; attribute vec2 corner;
    void main() {
      vec4 a = projection * view * vec4(start, 1.0), b = projection * view * vec4(end, 1.0);
      float near = 0.001;
      if (a.w < near && b.w < near) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
      if (a.w < near) a = mix(b, a, (b.w - near) / (b.w - a.w));
      if (b.w < near) b = mix(a, b, (a.w - near) / (a.w - b.w));
      vec2 direction = (b.xy / b.w - a.xy / a.w) * size;
      direction = length(direction) > 0.0 ? normalize(direction) : vec2(1.0, 0.0);
      vec4 place = mix(a, b, corner.x);
      gl_Position = place + vec4(vec2(-direction.y, direction.x) * corner.y * width / size * place.w, 0.0, 0.0);
    }`,
  frag: "precision mediump float; uniform vec3 colour; void main() { gl_FragColor = vec4(colour, 1.0); }",
  attributes: {
    corner: { buffer: regl.buffer([[0, -1], [1, -1], [1, 1], [0, -1], [1, 1], [0, 1]]), divisor: 0 },
    start: { buffer: regl.prop("points"), divisor: 1, stride: 12, offset: 0 },
    end: { buffer: regl.prop("points"), divisor: 1, stride: 12, offset: 12 },
  },
  uniforms: { ...view, size: (c) => [c.viewportWidth, c.viewportHeight], width: (c, p) => p.width * c.pixelRatio, colour: regl.prop("colour") },
  count: 6,
  instances: regl.prop("segments"),
});

const drawPoints = regl({
  vert: `precision highp float; uniform mat4 projection, view; uniform float size; attribute vec3 place, colour; varying vec3 shade;
    void main() { gl_Position = projection * view * vec4(place, 1.0); gl_PointSize = size; shade = colour; }`,
  frag: "precision mediump float; varying vec3 shade; void main() { gl_FragColor = vec4(shade, 1.0); }",
  attributes: { place: regl.prop("places"), colour: { buffer: regl.prop("colours"), normalized: true } },
  uniforms: { ...view, size: (c, p) => p.size * c.pixelRatio },
  count: regl.prop("count"),
  primitive: "points",
});

// A surface, lit from the viewer: coloured by its error through the colour map, by its own colours, or plain.
const drawSurface = regl({
  vert: `precision highp float; uniform mat4 projection, view; attribute vec3 place, colour; attribute float share;
    varying vec3 shade, eye; varying float part;
    void main() { vec4 seen = view * vec4(place, 1.0); gl_Position = projection * seen; eye = seen.xyz; shade = colour; part = share; }`,
  frag: `#extension GL_OES_standard_derivatives : enable
    precision highp float; uniform sampler2D map; uniform float byError, lit, backs; varying vec3 shade, eye; varying float part;
    void main() {
      if (lit > 0.5 && backs < 0.5 && !gl_FrontFacing) discard; // into a closed room from outside
      vec3 normal = normalize(cross(dFdx(eye), dFdy(eye)));
      vec3 base = mix(shade, texture2D(map, vec2(part, 0.5)).rgb, byError);
      float facing = abs(dot(normal, normalize(eye)));
      gl_FragColor = vec4(base * mix(1.0, 0.35 + 0.65 * facing, lit), 1.0);
    }`,
  attributes: {
    place: regl.prop("places"),
    colour: { buffer: regl.prop("colours"), normalized: true },
    share: { buffer: regl.prop("shares"), normalized: true },
  },
  uniforms: { ...view, map: colourMap, byError: regl.prop("byError"), lit: regl.prop("lit"), backs: () => (state.shown.backs ? 1 : 0) },
  elements: regl.prop("elements"),
});

function lineOf(points, colour, width) {
  const flat = Float32Array.from(points.flat());
  return { points: regl.buffer(flat), segments: Math.max(points.length - 1, 0), colour, width };
}

// ---- what is shown -----------------------------------------------------------------------------------

const state = { frame: 0, sequence: 0, playing: false, through: false, shown: {}, pointer: null };
const lines = [];
let surface = null;
let cloud = null;
const kept = new Map(); // clouds of the frames that were visited
let frustums = [];
const images = { colour: null, depth: null, metres: null };
const sequence = () => data.sequences[state.sequence];
const frames = () => (data.sequences.length ? sequence().frames : []);
const hex = (text) => [1, 3, 5].map((i) => parseInt(text.slice(i, i + 2), 16) / 255);

function around(low, high) {
  return { target: low.map((v, k) => (v + high[k]) / 2), distance: Math.max(0.5, 1.15 * Math.hypot(...minus(high, low))) };
}

function extent() {
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  const add = (p) => {
    for (let k = 0; k < 3; k++) {
      low[k] = Math.min(low[k], p[k]);
      high[k] = Math.max(high[k], p[k]);
    }
  };
  for (const one of data.surfaces) {
    add(one.from);
    add(one.to);
  }
  if (!data.surfaces.length) {
    for (const one of lines) one.places.forEach(add);
    if (cloud) for (let i = 0; i < cloud.count; i += 97) add(cloud.where.subarray(3 * i, 3 * i + 3));
  }
  return low[0] <= high[0] ? [low, high] : [[-1, -1, -1], [1, 1, 1]];
}

const eye = { azimuth: -0.9, elevation: 0.6, distance: 4, target: [0, 0, 0] };

function eyePlace() {
  const c = Math.cos(eye.elevation);
  return along(eye.target, eye.distance, [c * Math.cos(eye.azimuth), c * Math.sin(eye.azimuth), Math.sin(eye.elevation)]);
}

function reset() {
  Object.assign(eye, { azimuth: -0.9, elevation: 0.6, ...around(...extent()) });
  eye.distance /= Math.min(1, world.clientWidth / Math.max(world.clientHeight, 1)); // a narrow screen
  state.through = false;
  draw();
}

function camera() {
  const aspect = world.width / Math.max(world.height, 1);
  const pose = state.through && poseNow();
  if (pose) {
    const axes = axesOf(pose);
    const s = sequence();
    const half = Math.max(s.height / 2 / s.fy, s.width / 2 / s.fx / aspect);
    return { view: lookAt(pose, along(pose, 1, axes[2]), axes[1].map((v) => -v)), projection: perspective(half, aspect, 0.02, 500) };
  }
  return { view: lookAt(eyePlace(), eye.target, [0, 0, 1]), projection: perspective(0.41 / Math.min(aspect, 1), aspect, eye.distance / 500, eye.distance * 50) };
}

const inScope = regl({ context: { projection: (c, p) => p.projection, view: (c, p) => p.view } });
let waiting = false;

function draw() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    const ratio = Math.min(devicePixelRatio, 2);
    const width = Math.round(world.clientWidth * ratio);
    const height = Math.round(world.clientHeight * ratio);
    if (world.width !== width || world.height !== height) Object.assign(world, { width, height });
    regl.poll();
    const back = hex(getComputedStyle(document.body).getPropertyValue("--back").trim() || "#ffffff");
    inScope(camera(), () => {
      regl.clear({ color: [...back, 1], depth: 1 });
      if (surface && state.shown.surface) surface.parts.forEach((part) => drawSurface(part));
      if (state.shown.points) {
        if (cloud) drawPoints({ ...cloud, size: 2 });
        if (state.shown.all) for (const one of kept.values()) if (one !== cloud) drawPoints({ ...one, size: 1.5 });
      }
      for (const one of lines) if (state.shown[one.key]) drawLine(one.line);
      if (!state.through) drawLine(frustums);
    });
  });
}

// ---- frames --------------------------------------------------------------------------------------------

function poseNow() {
  const frame = frames()[state.frame];
  return frame ? frame.pose : null;
}

// Edges of the camera's pyramid: its tip to four corners, and the corners' rectangle.
function frustum(pose, colour, width) {
  const s = data.sequences.length ? sequence() : { width: 640, height: 480, fx: 525, fy: 525, cx: 319.5, cy: 239.5 };
  const axes = axesOf(pose);
  const reach = 0.04 * Math.max(eye.distance, 1);
  const corner = (u, v) => inWorld(pose, axes, [((u - s.cx) / s.fx) * reach, ((v - s.cy) / s.fy) * reach, reach]);
  const four = [corner(0, 0), corner(s.width, 0), corner(s.width, s.height), corner(0, s.height)];
  const tip = pose.slice(0, 3);
  const strip = [four[0], four[1], four[2], four[3], four[0], tip, four[1], four[2], tip, four[3]];
  return lineOf(strip, colour, width);
}

function image(id) {
  return new Promise((done, failed) => {
    const one = new Image();
    one.onload = () => done(one);
    one.onerror = () => failed(new Error(`${id} cannot be decoded`));
    one.src = `data:image/webp;base64,${$(id).textContent}`;
  });
}

async function loaded(frame, s) {
  const [picture, units] = await Promise.all([frame.colour ? image(frame.colour) : null, frame.depth ? wholeNumbers(frame.depth, Uint16Array) : null]);
  return { picture, units };
}

function paint(frame, s, found) {
  const colour = $("colour");
  const depth = $("depth");
  colour.parentElement.hidden = !found.picture;
  depth.parentElement.hidden = !found.units;
  images.colour = images.metres = null;
  if (found.picture) {
    Object.assign(colour, { width: s.width, height: s.height });
    const context = colour.getContext("2d", { willReadFrequently: true });
    context.drawImage(found.picture, 0, 0);
    images.colour = context.getImageData(0, 0, s.width, s.height).data;
  }
  if (found.units) {
    const [w, h] = [s.depth_width, s.depth_height];
    Object.assign(depth, { width: w, height: h });
    const context = depth.getContext("2d");
    const pixels = context.createImageData(w, h);
    const metres = new Float32Array(w * h);
    const last = data.ramp.length / 3 - 1;
    for (let i = 0; i < w * h; i++) {
      const z = (metres[i] = found.units[i] / s.units_per_metre);
      const k = 3 * Math.round(last * Math.min(Math.max((z - s.near_m) / Math.max(s.far_m - s.near_m, 1e-6), 0), 1));
      if (z > 0) for (let c = 0; c < 3; c++) pixels.data[4 * i + c] = data.ramp[k + c];
      pixels.data[4 * i + 3] = 255;
    }
    context.putImageData(pixels, 0, 0);
    images.metres = metres;
  }
}

function cloudOf(frame, s) {
  if (!frame.pose || !images.metres) return null;
  const axes = axesOf(frame.pose);
  const [w, h, step] = [s.depth_width, s.depth_height, s.depth_step];
  const where = new Float32Array(3 * w * h);
  const shades = new Uint8Array(3 * w * h);
  let count = 0;
  for (let y = 0; y < h; y++) {
    for (let x = 0; x < w; x++) {
      const z = images.metres[y * w + x];
      if (!(z > 0)) continue;
      const px = ((x * step - s.cx) / s.fx) * z;
      const py = ((y * step - s.cy) / s.fy) * z;
      for (let k = 0; k < 3; k++) {
        where[3 * count + k] = frame.pose[k] + px * axes[0][k] + py * axes[1][k] + z * axes[2][k];
        shades[3 * count + k] = images.colour ? images.colour[4 * (y * step * s.width + x * step) + k] : 160;
      }
      count++;
    }
  }
  return { where: where.subarray(0, 3 * count), places: regl.buffer(where.subarray(0, 3 * count)), colours: regl.buffer(shades.subarray(0, 3 * count)), count };
}

let asked = 0;

async function show(number) {
  const all = frames();
  state.frame = Math.min(Math.max(number, 0), Math.max(all.length - 1, lastRow()));
  $("frame").value = state.frame;
  const mine = ++asked;
  const frame = all[state.frame];
  if (frame) {
    const s = sequence();
    const found = await loaded(frame, s);
    if (mine !== asked) return;
    paint(frame, s, found);
    const key = `${state.sequence}/${state.frame}`;
    if (!kept.has(key)) kept.set(key, cloudOf(frame, s));
    if (!kept.get(key)) kept.delete(key);
    cloud = kept.get(key) || null;
    $("frame_text").textContent = `frame ${frame.number}, ${frame.stamp_s.toFixed(3)} s`;
  } else if (lines.length) {
    $("frame_text").textContent = `pose ${state.frame}, ${stampNow().toFixed(3)} s`;
  }
  frustums = posesNow().map(([pose, colour]) => frustum(pose, colour, 1.5));
  point();
  chart();
  draw();
}

const lastRow = () => Math.max(-1, ...data.trajectories.map((one) => one.count - 1));

function stampNow() {
  const frame = frames()[state.frame];
  if (frame) return frame.stamp_s;
  const one = lines.find((l) => l.stamps && l.stamps.length > state.frame) || lines[0];
  return one ? one.stamps[Math.min(state.frame, one.stamps.length - 1)] : 0;
}

function rowAt(stamps, stamp) {
  let low = 0;
  let high = stamps.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (stamps[middle] <= stamp) low = middle;
    else high = middle;
  }
  return Math.abs(stamps[low] - stamp) <= Math.abs(stamps[high] - stamp) ? low : high;
}

// The camera now, by the sequence's pose and by each trajectory that has one near its stamp.
function posesNow() {
  const found = [];
  const stamp = stampNow();
  for (const one of lines) {
    if (!state.shown[one.key] || !one.poses) continue;
    const row = rowAt(one.stamps, stamp);
    const step = one.stamps.length > 1 ? (one.stamps[one.stamps.length - 1] - one.stamps[0]) / (one.stamps.length - 1) : 1;
    if (Math.abs(one.stamps[row] - stamp) <= Math.max(step, 1e-3)) found.push([Array.from(one.poses.subarray(7 * row, 7 * row + 7)), one.line.colour]);
  }
  if (!found.length && poseNow()) found.push([poseNow(), hex("#e69f00")]);
  return found;
}

// ---- depth under the cursor ----------------------------------------------------------------------------

function point(event) {
  if (event) {
    const box = event.target.getBoundingClientRect();
    state.pointer = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  }
  const name = data.sequences.length > 1 ? `${sequence().name}: ` : "";
  $("colour_text").textContent = `${name}colour`;
  $("depth_text").textContent = `${name}depth: point at a pixel`;
  if (!state.pointer || !data.sequences.length) return;
  const s = sequence();
  const [u, v] = [Math.min(Math.floor(state.pointer[0] * s.width), s.width - 1), Math.min(Math.floor(state.pointer[1] * s.height), s.height - 1)];
  if (u < 0 || v < 0) return;
  if (images.colour) {
    const at = 4 * (v * s.width + u);
    $("colour_text").textContent = `${name}colour at (${u}, ${v}): ${Array.from(images.colour.subarray(at, at + 3)).join(", ")}`;
  }
  if (images.metres) {
    const z = images.metres[Math.floor(v / s.depth_step) * s.depth_width + Math.floor(u / s.depth_step)];
    $("depth_text").textContent = `${name}depth at (${u}, ${v}): ${z > 0 ? `${z.toFixed(4)} m` : "no measurement"}`;
  }
}

// ---- error over time -----------------------------------------------------------------------------------

function chart() {
  const canvas = $("error");
  const drawn = lines.filter((one) => one.errors && state.shown[one.key]);
  canvas.hidden = !lines.some((one) => one.errors);
  if (canvas.hidden) return;
  const ratio = Math.min(devicePixelRatio, 2);
  const [w, h] = [canvas.clientWidth, canvas.clientHeight];
  Object.assign(canvas, { width: w * ratio, height: h * ratio });
  const g = canvas.getContext("2d");
  g.scale(ratio, ratio);
  const style = getComputedStyle(document.body);
  g.font = "11px system-ui, sans-serif";
  g.fillStyle = style.getPropertyValue("--faint");
  const frame = { left: 52, right: w - 8, top: 14, bottom: h - 18 };
  const stamps = drawn.flatMap((one) => [one.stamps[0], one.stamps[one.stamps.length - 1]]);
  const [first, last] = [Math.min(...stamps), Math.max(...stamps)];
  let most = 1e-9;
  for (const one of drawn) for (const e of one.errors) if (e > most) most = e;
  const x = (s) => frame.left + ((s - first) / Math.max(last - first, 1e-9)) * (frame.right - frame.left);
  const y = (e) => frame.bottom - (e / most) * (frame.bottom - frame.top);
  canvas.stampAt = (px) => first + ((px - frame.left) / (frame.right - frame.left)) * (last - first);
  g.fillText("position error [mm] after alignment", frame.left, 10);
  g.textAlign = "right";
  g.fillText(most.toPrecision(3), frame.left - 4, frame.top + 8);
  g.fillText("0", frame.left - 4, frame.bottom);
  if (drawn.length) {
    g.fillText(`${last.toFixed(1)} s`, frame.right, h - 4);
    g.textAlign = "left";
    g.fillText(`${first.toFixed(1)} s`, frame.left, h - 4);
  }
  g.strokeStyle = style.getPropertyValue("--line");
  g.strokeRect(frame.left, frame.top, frame.right - frame.left, frame.bottom - frame.top);
  for (const one of drawn) {
    g.strokeStyle = one.css;
    g.lineWidth = 1.5;
    g.beginPath();
    one.errors.forEach((e, i) => (Number.isFinite(e) ? g.lineTo(x(one.stamps[i]), y(e)) : g.moveTo(x(one.stamps[i]), frame.bottom)));
    g.stroke();
  }
  g.strokeStyle = style.getPropertyValue("--text");
  g.lineWidth = 1;
  g.beginPath();
  g.moveTo(x(stampNow()), frame.top);
  g.lineTo(x(stampNow()), frame.bottom);
  g.stroke();
}

function toStamp(stamp) {
  const list = frames().length ? frames().map((f) => f.stamp_s) : (lines.find((one) => one.errors) || lines[0]).stamps;
  show(rowAt(list, stamp));
}

// ---- mouse, touch, keys ----------------------------------------------------------------------------------

const fingers = new Map();

function turn(dx, dy) {
  eye.azimuth -= dx * 0.006;
  eye.elevation = Math.min(Math.max(eye.elevation + dy * 0.006, -1.55), 1.55);
}

function move(dx, dy) {
  const back = unit(minus(eyePlace(), eye.target));
  const right = unit(cross([0, 0, 1], back));
  const up = cross(back, right);
  const step = (eye.distance * 0.82) / Math.max(world.clientHeight, 1);
  eye.target = along(along(eye.target, -dx * step, right), dy * step, up);
}

function zoom(factor) {
  eye.distance = Math.min(Math.max(eye.distance * factor, 0.05), 1e4);
}

world.addEventListener("pointerdown", (event) => {
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
  world.setPointerCapture(event.pointerId);
  world.focus();
});
world.addEventListener("pointermove", (event) => {
  const before = fingers.get(event.pointerId);
  if (!before) return;
  const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
  const others = [...fingers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
  if (others.length) {
    const gap = (a) => Math.hypot(a[0] - others[0][0], a[1] - others[0][1]) || 1;
    zoom(gap(before) / gap([event.clientX, event.clientY]));
    move(dx / 2, dy / 2);
  } else if (event.shiftKey || event.buttons & 6) {
    move(dx, dy);
  } else {
    turn(dx, dy);
  }
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
  state.through = false;
  draw();
});
for (const end of ["pointerup", "pointercancel"]) world.addEventListener(end, (event) => fingers.delete(event.pointerId));
world.addEventListener("contextmenu", (event) => event.preventDefault());
world.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoom(Math.exp(event.deltaY * 0.001));
  draw();
}, { passive: false });

for (const id of ["colour", "depth"]) {
  $(id).addEventListener("pointermove", point);
  $(id).addEventListener("pointerdown", point);
}
$("error").addEventListener("pointerdown", (event) => toStamp(event.target.stampAt(event.offsetX)));
$("error").addEventListener("pointermove", (event) => event.buttons && toStamp(event.target.stampAt(event.offsetX)));

function play(on) {
  state.playing = on;
  $("play").textContent = on ? "\u275a\u275a" : "\u25b6";
  if (on) tick();
}

async function tick() {
  const last = Number($("frame").max);
  while (state.playing) {
    const began = performance.now();
    await show(state.frame >= last ? 0 : state.frame + 1);
    await new Promise((done) => setTimeout(done, Math.max(0, 66 - (performance.now() - began))));
  }
}

$("frame").addEventListener("input", (event) => show(Number(event.target.value)));
$("play").addEventListener("click", () => play(!state.playing));
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const inBar = event.target.id === "frame";
  const key = event.key;
  if (key === "ArrowRight" && !inBar) show(state.frame + 1);
  else if (key === "ArrowLeft" && !inBar) show(state.frame - 1);
  else if (key === "Home" && !inBar) show(0);
  else if (key === "End" && !inBar) show(Number($("frame").max));
  else if (key === " " && event.target.tagName !== "BUTTON" && event.target.type !== "checkbox") play(!state.playing);
  else if (key === "+" || key === "=") zoom(0.8);
  else if (key === "-") zoom(1.25);
  else if (key.toLowerCase() === "c") state.through = !state.through;
  else if (key.toLowerCase() === "r") return reset();
  else return;
  event.preventDefault();
  draw();
});
addEventListener("resize", () => {
  chart();
  draw();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  chart();
  draw();
});

// ---- start -----------------------------------------------------------------------------------------------

function toggle(key, text, css, on = true) {
  const label = document.createElement("label");
  const box = document.createElement("input");
  box.type = "checkbox";
  box.checked = state.shown[key] = on;
  box.addEventListener("change", () => {
    state.shown[key] = box.checked;
    frustums = posesNow().map(([pose, colour]) => frustum(pose, colour, 1.5));
    chart();
    draw();
  });
  label.append(box);
  if (css) {
    const dash = document.createElement("i");
    dash.style.background = css;
    label.append(dash);
  }
  label.append(text);
  $("keys").append(label);
}

function choice() {
  const box = document.createElement("select");
  box.setAttribute("aria-label", "sequence");
  data.sequences.forEach((s, i) => box.append(new Option(s.name, i)));
  box.addEventListener("change", () => {
    state.sequence = Number(box.value);
    $("frame").max = Math.max(frames().length - 1, 0);
    show(state.frame);
  });
  $("keys").prepend(box);
}

async function readTrajectory(one, index) {
  const [stamps, poses, errors] = await Promise.all([floats64(one.stamps), floats(one.poses), one.errors ? floats(one.errors) : null]);
  const places = [];
  for (let i = 0; i < one.count; i++) places.push([poses[7 * i], poses[7 * i + 1], poses[7 * i + 2]]);
  const line = lineOf(places, hex(one.colour), one.is_truth ? 1.2 : 2);
  lines.push({ key: `t${index}`, line, places, stamps, poses: one.has_rotations ? poses : null, errors, css: one.colour });
  toggle(`t${index}`, one.label, one.colour);
}

async function floats64(id) {
  return new Float64Array((await inflated(id)).buffer);
}

async function readSurface(one) {
  const whole = await Promise.all([wholeNumbers(one.x, Uint16Array), wholeNumbers(one.y, Uint16Array), wholeNumbers(one.z, Uint16Array)]);
  const count = whole[0].length;
  const where = new Float32Array(3 * count);
  for (let k = 0; k < 3; k++) {
    const step = (one.high[k] - one.low[k]) / 65535;
    for (let i = 0; i < count; i++) where[3 * i + k] = one.low[k] + whole[k][i] * step;
  }
  const corners = one.triangles ? await wholeNumbers(one.triangles, Uint32Array) : null;
  const shades = one.colours ? await inflated(one.colours) : new Uint8Array(3 * count).fill(190);
  const shares = one.shares ? await inflated(one.shares) : new Uint8Array(count);
  const places = regl.buffer(where);
  const colours = regl.buffer(shades);
  const part = { places, colours, shares: regl.buffer(shares), byError: one.shares ? 1 : 0, lit: corners ? 1 : 0 };
  part.elements = regl.elements(corners ? { data: corners, primitive: "triangles", type: "uint32" } : { primitive: "points", count });
  surface = surface || { parts: [] };
  surface.parts.push(part);
  if (!("surface" in state.shown)) toggle("surface", data.surfaces.map((s) => s.name).join(", "));
  if (one.shares) legend(one);
  if (corners && !("backs" in state.shown)) toggle("backs", "faces seen from behind", null, false);
}

function legend(one) {
  const row = document.createElement("div");
  row.id = "scale";
  const bar = document.createElement("canvas");
  Object.assign(bar, { width: data.ramp.length / 3, height: 1 });
  const pixels = bar.getContext("2d").createImageData(bar.width, 1);
  for (let i = 0; i < bar.width; i++) pixels.data.set([...data.ramp.slice(3 * i, 3 * i + 3), 255], 4 * i);
  bar.getContext("2d").putImageData(pixels, 0, 0);
  row.append("error 0", bar, `${one.max_mm.toPrecision(3)} mm`);
  $("keys").append(row);
}

async function start() {
  const has = data.sequences.length > 0;
  $("pictures").hidden = !has;
  document.querySelector("main").classList.toggle("alone", !has);
  if (data.sequences.length > 1) choice();
  if (has) {
    toggle("points", "points of the frame");
    toggle("all", "points of all visited frames", null, false);
  }
  for (const [index, one] of data.trajectories.entries()) await readTrajectory(one, index);
  const rows = has ? frames().length : lastRow() + 1;
  $("frame").max = Math.max(rows - 1, 0);
  $("run").hidden = rows < 2;
  await show(0);
  reset();
  document.body.dataset.first = Math.round(performance.now()); // the first picture stands
  for (const one of data.surfaces) await readSurface(one);
  if (data.surfaces.length) reset();
  document.body.dataset.ready = "true";
}

start();
