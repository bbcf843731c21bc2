"use strict";
// Comfort only: the page reads completely without this. Values under the pointer, zoom of the ellipses, switches of the
// error budgets; every number comes from the page itself.
(() => {
  const SVG = "http://www.w3.org/2000/svg";
  const make = (tag, attributes = {}, space) => {
    const e = space ? document.createElementNS(SVG, tag) : document.createElement(tag);
    for (const [key, value] of Object.entries(attributes)) e.setAttribute(key, value);
    return e;
  };

  // numbers as the page writes them: three significant digits
  const number = v => {
    if (v === 0) return "0";
    const size = Math.abs(v);
    const text = size >= 1e5 || size < 1e-3 ? v.toExponential(2).replace("e+", "e").replace("e", " × 10^") : Number(v.toPrecision(3)).toString();
    return text.replace("-", "−");
  };
  const date = (origin, days) =>
    new Date(Date.parse(origin + "Z") + days * 864e5).toISOString().slice(0, 16).replace("T", " ") + " TDB";

  // one box that says what is under the pointer
  const tip = make("div", { class: "tip", role: "status" });
  tip.hidden = true;
  document.body.append(tip);
  const say = (event, text) => {
    tip.textContent = text;
    tip.hidden = false;
    const right = event.clientX + 14 + tip.offsetWidth < document.documentElement.clientWidth;
    tip.style.left = `${window.scrollX + (right ? event.clientX + 14 : Math.max(4, event.clientX - 14 - tip.offsetWidth))}px`;
    tip.style.top = `${window.scrollY + event.clientY + 14}px`;
  };
  const hush = () => { tip.hidden = true; };
  for (const mark of document.querySelectorAll("svg title")) {
    const owner = mark.parentNode, text = mark.textContent;
    mark.remove();
    owner.addEventListener("pointermove", event => { say(event, text); event.stopPropagation(); });
    owner.addEventListener("pointerleave", hush);
  }

  // how a panel maps pixels to values: kind, pixel at the start and end, value at the start and end
  const axis = text => {
    const [kind, ...rest] = text.split(" ");
    const [p0, p1, v0, v1] = rest.map(Number);
    return {
      kind, p0, p1, v0, v1,
      value: p => {
        const part = (p - p0) / (p1 - p0);
        return kind === "log" ? v0 * (v1 / v0) ** part : v0 + (v1 - v0) * part;
      },
    };
  };
  const told = (scale, name, v, origin) => {
    if (scale.kind === "time") return date(origin, v);
    const [what, unit] = name.split(", ");
    if (scale.kind !== "log" && Math.abs(v) < 1e-4 * Math.abs(scale.v1 - scale.v0)) v = 0;  // finer than a pixel
    return name === "" ? "" : `${what} ${number(v)}${unit ? " " + unit : ""}`;
  };
  const points = mark => {  // ends of strokes, and places of markers
    const of = e => e.tagName === "use" ? [[Number(e.getAttribute("x")), Number(e.getAttribute("y"))]]
      : e.tagName !== "path" || e.closest("defs") ? []
        : [...e.getAttribute("d").matchAll(/[ML](-?[\d.]+) (-?[\d.]+)/g)].map(m => [Number(m[1]), Number(m[2])]);
    mark.found ??= [mark, ...mark.querySelectorAll("path, use")].flatMap(of);
    return mark.found;
  };
  const place = (event, element) => new DOMPoint(event.clientX, event.clientY).matrixTransform(element.getScreenCTM().inverse());

  for (const panel of document.querySelectorAll("g.panel")) {
    const svg = panel.ownerSVGElement, data = panel.dataset;
    const x = axis(data.x), y = axis(data.y), series = [...panel.querySelectorAll(".s")];
    const ring = make("circle", { class: "near", r: 4, visibility: "hidden" }, true);
    panel.append(ring);
    const quiet = () => { ring.setAttribute("visibility", "hidden"); hush(); };
    const ellipse = data.k ? data.k.split(" ").map(Number) : null;
    svg.addEventListener("pointermove", event => {
      const p = place(event, svg), inside = (v, a) => v >= Math.min(a.p0, a.p1) - 3 && v <= Math.max(a.p0, a.p1) + 3;
      if (!inside(p.x, x) || !inside(p.y, y)) return;
      if (ellipse) {
        const inner = panel.querySelector(".view"), q = place(event, inner.firstElementChild);
        const a = x.value(q.x), b = y.value(q.y);
        const k2 = ellipse[0] * a * a + 2 * ellipse[1] * a * b + ellipse[2] * b * b, k = Math.sqrt(Math.max(0, k2));
        say(event, `${told(x, data.xn, a)}; ${told(y, data.yn, b)}: on the ${number(k)}σ ellipse, which holds ${(100 * (1 - Math.exp(-k2 / 2))).toFixed(1)} %`);
        return;
      }
      let best = null, nearest = 24 ** 2;
      for (const mark of series) for (const [a, b] of points(mark)) {
        const far = (a - p.x) ** 2 + (b - p.y) ** 2;
        if (far < nearest) { nearest = far; best = [a, b, mark.dataset.n]; }
      }
      if (!best) { if (series.length) quiet(); return; }
      ring.setAttribute("cx", best[0]);
      ring.setAttribute("cy", best[1]);
      ring.setAttribute("visibility", "visible");
      const values = [told(x, data.xn, x.value(best[0]), data.origin), told(y, data.yn, y.value(best[1]), data.origin)];
      say(event, `${best[2]}: ${values.filter(Boolean).join(", ")}`);
    });
    svg.addEventListener("pointerleave", quiet);
  }

  // ellipses: buttons, drag, double click; Ctrl and the wheel
  const ticks = (scale, low, high) => {
    const rough = (high - low) / 5, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map(k => k * power).find(s => s >= rough), found = [];
    for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(k * step);
    return found.map(v => [v, Number(v.toPrecision(6))]);
  };
  for (const view of document.querySelectorAll("svg.view")) {
    const svg = view.ownerSVGElement, panel = view.parentNode;
    const x = axis(panel.dataset.x), y = axis(panel.dataset.y);
    const home = view.getAttribute("viewBox").split(" ").map(Number);
    const axes = svg.querySelector(".axes"), first = axes.cloneNode(true), labels = [...panel.querySelectorAll("text")];
    let box = [...home];
    const redraw = () => {
      view.setAttribute("viewBox", box.join(" "));
      const same = box.every((v, i) => Math.abs(v - home[i]) < 1e-9);
      for (const label of labels) label.setAttribute("visibility", same ? "visible" : "hidden");
      if (same) { axes.replaceChildren(...first.cloneNode(true).childNodes); return; }
      const grid = [], texts = [];
      const across = p => home[0] + (p - box[0]) / box[2] * home[2], down = p => home[1] + (p - box[1]) / box[3] * home[3];
      const pixel = (a, v) => a.p0 + (v - a.v0) / (a.v1 - a.v0) * (a.p1 - a.p0);
      const ends = (a, from, size) => [a.value(from), a.value(from + size)].sort((p, q) => p - q);
      for (const [v, text] of ticks(x, ...ends(x, box[0], box[2]))) {
        const p = across(pixel(x, v));
        grid.push(`M${p} ${home[1]}V${home[1] + home[3]}`);
        texts.push([p, home[1] + home[3] + 12.5, "middle", text]);
      }
      for (const [v, text] of ticks(y, ...ends(y, box[1], box[3]))) {
        const p = down(pixel(y, v));
        grid.push(`M${home[0]} ${p}H${home[0] + home[2]}`);
        texts.push([home[0] - 4, p + 3.6, "end", text]);
      }
      const frame = first.querySelector(".frame").cloneNode();
      axes.replaceChildren(make("path", { class: "grid", d: grid.join("") }, true), frame, ...texts.map(([a, b, anchor, text]) => {
        const t = make("text", { x: a, y: b, "text-anchor": anchor }, true);
        t.textContent = String(text).replace("-", "−");
        return t;
      }));
    };
    const zoom = (factor, cx = box[0] + box[2] / 2, cy = box[1] + box[3] / 2) => {
      const size = Math.min(1, Math.max(0.005, factor * box[2] / home[2])) * home[2] / box[2];
      box = [cx - (cx - box[0]) * size, cy - (cy - box[1]) * size, box[2] * size, box[3] * size];
      if (box[2] >= home[2] * 0.999) box = [...home];
      redraw();
    };
    const tools = make("div", { class: "tools", role: "group", "aria-label": "Zoom" });
    for (const [text, name, act] of [["+", "Zoom in", () => zoom(0.6)], ["−", "Zoom out", () => zoom(1 / 0.6)],
      ["reset", "Whole ellipse", () => { box = [...home]; redraw(); }]]) {
      const button = make("button", { type: "button", "aria-label": name });
      button.textContent = text;
      button.addEventListener("click", act);
      tools.append(button);
    }
    svg.parentNode.before(tools);
    let held = null;
    view.addEventListener("pointerdown", event => {
      if (box[2] === home[2]) return;
      held = [event.clientX, event.clientY, ...box];
      view.setPointerCapture(event.pointerId);
    });
    view.addEventListener("pointermove", event => {
      if (!held) return;
      const scale = svg.getScreenCTM().a * home[2] / box[2];
      box[0] = held[2] - (event.clientX - held[0]) / scale;
      box[1] = held[3] - (event.clientY - held[1]) / scale;
      redraw();
    });
    for (const kind of ["pointerup", "pointercancel"]) view.addEventListener(kind, () => { held = null; });
    const about = event => { const p = place(event, view.firstElementChild); return [p.x, p.y]; };
    view.addEventListener("dblclick", event => { event.preventDefault(); zoom(0.6, ...about(event)); });
    view.addEventListener("wheel", event => {
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      zoom(event.deltaY > 0 ? 1.2 : 1 / 1.2, ...about(event));
    }, { passive: false });
  }

  // error budgets: switch sources off. With the gain as it is variances subtract exactly; re-optimised sigmas are known
  // for one source at a time only, and only then are shown.
  for (const table of document.querySelectorAll("table.budget")) {
    const rows = [...table.tBodies[0].rows], total = Number(table.dataset.total), foot = table.tFoot.rows[0];
    const cell = foot.lastElementChild, shown = v => `${number(v * Number(table.dataset.factor))} ${table.dataset.unit}`;
    cell.classList.add("live");
    cell.setAttribute("aria-live", "polite");
    const update = () => {
      const off = rows.filter(row => !row.querySelector("input").checked);
      rows.forEach(row => row.classList.toggle("off", off.includes(row)));
      if (!off.length) { cell.textContent = "untick sources to see what is left"; return; }
      const left = off.length === rows.length ? 0 : 1 - off.reduce((sum, row) => sum + Number(row.dataset.share), 0);
      const best = off.length === 1 && off[0].dataset.new ? `; re-optimised ${shown(Number(off[0].dataset.new))}` : "";
      cell.textContent = `without: ${shown(total * Math.sqrt(Math.max(0, left)))} with the gain as it is${best}`;
    };
    for (const row of rows) {
      const head = row.cells[0], label = make("label"), box = make("input", { type: "checkbox" });
      box.checked = true;
      label.append(box, ...head.childNodes);
      head.append(label);
      box.addEventListener("change", update);
    }
    update();
  }
})();
