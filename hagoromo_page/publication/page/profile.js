// ---------------------------------------------------------------- heights along a line, with their 95 % band
// As hagoromo/measurement/inspection/profile.py; errors of distances are the fields of hagoromo_page/publication/closely.py.

const NORMAL_95 = 1.959964, MOST_PLACES = 2000;
let errorFields = null;

async function readErrors() {
  const own = data.closely && data.closely.errors;
  if (!own) return;
  const planes = await unpacked(own.header, byId("hv-errors").textContent), { width, height } = own.header, fields = [];
  for (let k = 0; `e${k}` in planes; k++) fields.push(Float32Array.from(planes[`e${k}`], (v) => ((2 * v) / own.top - 1) * own.range));
  const at = (values, x, y) => {  // page [px] → between cells
    const u = Math.min(Math.max((own.x + x * data.pixel) / own.step - 0.5, 0), width - 1);
    const v = Math.min(Math.max((own.y + y * data.pixel) / own.step - 0.5, 0), height - 1);
    const c = Math.min(Math.floor(u), Math.max(width - 2, 0)), r = Math.min(Math.floor(v), Math.max(height - 2, 0)), du = u - c, dv = v - r;
    const get = (row, column) => values[Math.min(row, height - 1) * width + Math.min(column, width - 1)];
    return (1 - dv) * ((1 - du) * get(r, c) + du * get(r, c + 1)) + dv * ((1 - du) * get(r + 1, c) + du * get(r + 1, c + 1));
  };
  errorFields = { fields, short: Float32Array.from(planes.short, (v) => (v / own.top) * own.short), at, step: own.step };
}

function ownHeights(level, c, r) {  // depth of a pixel of a level, and its error by the width of the pixels [m]; 0 where unknown, −1 where its tile is not here
  const one = data.levels[level];
  if (c < 0 || r < 0 || c >= one.width || r >= one.height) return [0, 0];
  const column = Math.floor(c / data.side), row = Math.floor(r / data.side), tile = tiles.get(`${level}-${column}-${row}`);
  if (!tile || !tile.heights) return [-1, 0];
  const i = (r - tile.y) * tile.width + c - tile.x, range = data.scales.depth, ends = data.scales.width;
  if (!tile.heights.label[i]) return [0, 0];
  const code = tile.heights.width && ends ? tile.heights.width[i] : 0;
  return [range[0] + ((range[1] - range[0]) * tile.heights.depth[i]) / 65535, code ? ends[0] * (ends[1] / ends[0]) ** ((code - 1) / (data.scales.width_top - 1)) : 0];
}

function heightsAt(x, y) {  // page [px] → depth and its error by the width of the pixels [m], between pixels of the finest level that is here; null where unknown
  for (let level = 0; level < data.levels.length; level++) {
    const factor = data.levels[level].factor, u = x / factor - 0.5, v = y / factor - 0.5, c = Math.floor(u), r = Math.floor(v);
    const four = [[c, r], [c + 1, r], [c, r + 1], [c + 1, r + 1]].map(([a, b]) => ownHeights(level, a, b));
    if (four.some(([depth]) => depth < 0)) continue;
    if (four.some(([depth]) => depth === 0)) return null;
    const du = u - c, dv = v - r;
    return [0, 1].map((k) => (1 - dv) * ((1 - du) * four[0][k] + du * four[1][k]) + dv * ((1 - du) * four[2][k] + du * four[3][k]));
  }
  return null;
}

function placeAt(x, y, depth) {  // point [m] in the camera's axes; null where unknown
  return depth ? [((x - data.principal[0]) / data.focal[0]) * depth, ((y - data.principal[1]) / data.focal[1]) * depth, depth] : null;
}

const dot = (a, b) => a.reduce((sum, v, i) => sum + v * b[i], 0);
const minus = (a, b) => a.map((v, i) => v - b[i]);
const unit = (a) => { const size = Math.hypot(...a); return a.map((v) => v / size); };

function heightsAlong(a, b) {  // distance, height and standard error at places of a line [mm or px]; null without two ends
  const px = Math.hypot(b[0] - a[0], b[1] - a[1]), count = Math.min(Math.max(Math.ceil(px) + 1, 3), MOST_PLACES);
  const places = Array.from({ length: count }, (_, k) => a.map((v, i) => v + ((b[i] - v) * k) / (count - 1)));
  const found = places.map((p) => heightsAt(...p)), points = places.map((p, k) => placeAt(...p, found[k] && found[k][0])), first = points[0], last = points[count - 1];
  if (px < 2 || !first || !last) return null;
  const along = unit(minus(last, first)), middle = first.map((v, i) => -(v + last[i]) / 2), tilt = dot(middle, along);
  const up = unit(middle.map((v, i) => v - tilt * along[i])), length = Math.hypot(...minus(last, first));
  const perPixel = (first[2] + last[2]) / (data.focal[0] + data.focal[1]);  // m
  const factor = data.hasScale ? 1000 : data.pixel / perPixel;
  const made = { unit: data.hasScale ? "mm" : "px", places, distance: [], height: [], error: [] };
  const moved = (k, values) => errorFields.at(values, ...places[k]) * dot(unit(points[k]), up);
  const fields = errorFields ? errorFields.fields.map((one) => [one, moved(0, one), moved(count - 1, one)]) : [];
  const narrow = (k) => found[k][1] * dot(unit(points[k]), up), narrowEnds = [narrow(0), narrow(count - 1)];
  const ends = errorFields ? [moved(0, errorFields.short), moved(count - 1, errorFields.short)] : [];
  points.forEach((point, k) => {
    if (!point) { for (const one of [made.distance, made.height, made.error]) one.push(NaN); return; }
    const rise = minus(point, first), s = Math.min(Math.max(dot(rise, along) / length, 0), 1);
    made.distance.push(dot(rise, along) * factor);
    made.height.push(dot(rise, up) * factor);
    if (!errorFields) { made.error.push(NaN); return; }
    let variance = fields.reduce((sum, [one, p, q]) => sum + (moved(k, one) - (1 - s) * p - s * q) ** 2, 0);
    const away = (Math.min(k, count - 1 - k) * px * data.pixel) / (count - 1);  // photograph px from the nearer end
    const share = Math.min(Math.log(1 + away) / Math.log(1 + errorFields.step), 1);
    variance += share * (moved(k, errorFields.short) ** 2 + ((1 - s) * ends[0]) ** 2 + (s * ends[1]) ** 2);
    if (s > 0 && s < 1) variance += narrow(k) ** 2 + ((1 - s) * narrowEnds[0]) ** 2 + (s * narrowEnds[1]) ** 2;
    made.error.push(Math.sqrt(variance) * factor);
  });
  return made;
}

function markStart(at) {  // where distances are counted from
  if (heights) overlay.append(element("text", { x: at[0], y: at[1] - 10 }, "0"));
}

function follow(profile) {  // of the line that is drawn: its heights, or its length alone
  heights = profile && ruler ? heightsAlong(...ruler) : null;
  byId("hv-plot").hidden = !profile;
  byId("hv-heights").textContent = profile ? heightsText() : "";
  plotHeights();
}

function heightsText() {
  if (!heights) return "Drag a line on the object: both ends must lie on it.";
  const known = heights.height.filter(Number.isFinite), most = Math.max(...heights.error.filter(Number.isFinite), 0);
  const least = 1e-6 * Math.max(...known.map(Math.abs), 1e-9), text = (v) => (Math.abs(v) < least ? "0" : Number(v.toPrecision(3)).toString().replace("-", "−"));
  const band = most > 0 ? `, known to ± ${text(NORMAL_95 * most)} ${heights.unit} or better (95 %, by stated errors of the normals)` : ", without a band: the measurement states no errors";
  return `${text(heights.distance[heights.distance.length - 1])} ${heights.unit} long, heights ${text(Math.min(...known))} to ${text(Math.max(...known))} ${heights.unit} over the chord${band}`;
}

function ticks(low, high, most) {  // 1, 2 or 5 times a power of ten apart
  const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((v) => v * power).find((v) => v >= rough), made = [];
  for (let v = Math.ceil(low / step - 1e-9) * step; v <= high + 1e-9 * step; v += step) made.push(Math.abs(v) < 1e-9 * step ? 0 : v);
  return { made, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

function plotHeights() {
  const plot = byId("hv-profile");
  if (byId("hv-plot").hidden || !plot.clientWidth) return;
  const ratio = window.devicePixelRatio || 1, width = plot.clientWidth, height = plot.clientHeight, pen = plot.getContext("2d");
  plot.width = width * ratio;
  plot.height = height * ratio;
  pen.scale(ratio, ratio);
  if (!heights) return;
  const style = getComputedStyle(byId("hv")), ink = style.getPropertyValue("--hv-ink"), soft = style.getPropertyValue("--hv-soft"), line = style.getPropertyValue("--hv-line"), accent = style.getPropertyValue("--hv-accent");
  const band = heights.error.map((v) => (Number.isFinite(v) ? NORMAL_95 * v : 0)), known = heights.height.map((v, k) => k).filter((k) => Number.isFinite(heights.height[k]));
  let low = Math.min(...known.map((k) => heights.height[k] - band[k])), high = Math.max(...known.map((k) => heights.height[k] + band[k]));
  const room = 0.08 * Math.max(high - low, 1e-9), far = heights.distance[heights.distance.length - 1];
  low -= room;
  high += room;
  const box = { left: 58, right: width - 10, top: 20, bottom: height - 34 };
  const x = (v) => box.left + (v / far) * (box.right - box.left), y = (v) => box.bottom - ((v - low) / (high - low)) * (box.bottom - box.top);
  pen.font = "12px system-ui, sans-serif";
  pen.lineWidth = 1;
  const across = ticks(0, far, Math.max((box.right - box.left) / 80, 2)), up = ticks(low, high, 4);
  for (const v of up.made) { pen.strokeStyle = line; pen.beginPath(); pen.moveTo(box.left, y(v)); pen.lineTo(box.right, y(v)); pen.stroke(); pen.fillStyle = soft; pen.textAlign = "right"; pen.fillText(v.toFixed(up.digits), box.left - 6, y(v) + 4); }
  for (const v of across.made) { pen.strokeStyle = line; pen.beginPath(); pen.moveTo(x(v), box.top); pen.lineTo(x(v), box.bottom); pen.stroke(); pen.fillStyle = soft; pen.textAlign = "center"; pen.fillText(v.toFixed(across.digits), x(v), box.bottom + 14); }
  pen.textAlign = "left";
  const steeper = ((box.bottom - box.top) / (high - low)) / ((box.right - box.left) / far);
  pen.fillText(`height over the chord [${heights.unit}], drawn ${steeper.toPrecision(2)} times as high as long`, box.left, 12);
  pen.textAlign = "right";
  pen.fillText(`distance [${heights.unit}]`, box.right, height - 4);
  const runs = [];
  for (const k of known) { if (runs.length && runs[runs.length - 1].at(-1) === k - 1) runs[runs.length - 1].push(k); else runs.push([k]); }
  for (const run of runs) {
    pen.beginPath();
    run.forEach((k) => pen.lineTo(x(heights.distance[k]), y(heights.height[k] + band[k])));
    [...run].reverse().forEach((k) => pen.lineTo(x(heights.distance[k]), y(heights.height[k] - band[k])));
    pen.globalAlpha = 0.4;
    pen.fillStyle = accent;
    pen.fill();
    pen.globalAlpha = 1;
    pen.beginPath();
    run.forEach((k) => pen.lineTo(x(heights.distance[k]), y(heights.height[k])));
    pen.strokeStyle = ink;
    pen.lineWidth = 1.5;
    pen.stroke();
  }
}
