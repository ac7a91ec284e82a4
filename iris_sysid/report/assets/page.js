"use strict";
(() => {
  const {charts, film} = JSON.parse(document.getElementById("data").textContent);
  const NS = "http://www.w3.org/2000/svg", LENS = 2;  // half the width of a lens in radii of the body
  const root = document.documentElement, find = id => document.getElementById(id);
  const element = (name, attributes) => {
    const made = document.createElementNS(NS, name);
    for (const key in attributes) made.setAttribute(key, attributes[key]);
    return made;
  };
  const colour = name => {
    const probe = element("svg", {class: name});
    document.body.append(probe);
    const value = getComputedStyle(probe).getPropertyValue("--c").trim();
    probe.remove();
    return value || getComputedStyle(root).getPropertyValue("--ink").trim();
  };
  const rooted = name => getComputedStyle(root).getPropertyValue(name).trim();
  const plots = [];
  let now = 0, timer = 0;

  // ---- the film: every view shows the one scene

  const nearest = t => {
    let best = 0;
    film.t.forEach((at, k) => { if (Math.abs(at - t) < Math.abs(film.t[best] - t)) best = k; });
    return best;
  };
  const lensOf = body => {
    const svg = element("svg", {viewBox: "0 0 1 1", "aria-hidden": "true"});
    svg.append(element("use", {href: "#scene"}));
    svg.dataset.body = body;
    svg.style.display = "none";
    find("lenses").append(svg);
    return svg;
  };
  const lenses = film ? [...new Set(film.markers.map(one => one.body))].map(lensOf) : [];
  const drawMarkers = k => {
    const markers = find("markers");
    markers.replaceChildren();
    for (const one of film.markers) {
      const at = one.xyr[k];
      if (!at) continue;
      if (one.ring) {
        const place = {cx: at[0], cy: at[1], r: Math.max(at[2], 4)};
        markers.append(element("circle", {class: "ring halo-ring", ...place}), element("circle", {class: `ring ${one.colour}`, ...place}));
      } else markers.append(element("circle", {class: `dot ${one.colour}`, cx: at[0], cy: at[1], r: Math.min(3, Math.max(at[2] / 3, 1.5))}));
    }
  };
  const aim = k => {
    for (const svg of lenses) {
      const places = film.markers.filter(one => one.body == svg.dataset.body && one.xyr[k]).map(one => one.xyr[k]);
      svg.style.display = places.length ? "block" : "none";
      if (!places.length) continue;
      const [xs, ys, radii] = [0, 1, 2].map(axis => places.map(place => place[axis]));
      const [x, y] = [xs, ys].map(values => (Math.min(...values) + Math.max(...values)) / 2);
      const apart = Math.max(Math.max(...xs) - Math.min(...xs), Math.max(...ys) - Math.min(...ys));
      const half = Math.max(LENS * Math.max(...radii, 4), apart + 2 * Math.max(...radii));
      svg.setAttribute("viewBox", `${x - half} ${y - half * 0.7} ${2 * half} ${1.4 * half}`);
    }
  };
  const show = (k, from) => {
    now = k;
    find("frame").setAttribute("href", `data:image/jpeg;base64,${film.frames[k]}`);
    find("tracks").style.opacity = 0.35;
    drawMarkers(k);
    aim(k);
    find("scrub").value = k;
    const text = `${film.t[k].toFixed(2)} s`;
    find("moment").textContent = text;
    find("scrub").setAttribute("aria-valuetext", text);
    find("shown").textContent = `The frame at ${text}`;
    if (from !== "chart") for (const plot of plots) if (plot.overTime) plot.setCursor({left: plot.valToPos(film.t[k], "x"), top: -10}, false);
  };
  const play = () => {
    const step = Math.max(40, 1000 * (film.t[film.t.length - 1] - film.t[0]) / film.t.length);
    timer = timer ? (clearInterval(timer), 0) : setInterval(() => show((now + 1) % film.t.length), Math.min(step, 150));
    find("play").textContent = timer ? "Pause" : "Play";
  };

  // ---- the charts

  const path = (u, xs, ys) => {
    const {ctx} = u;
    ctx.beginPath();
    xs.forEach((x, k) => ctx[k ? "lineTo" : "moveTo"](u.valToPos(x, "x", true), u.valToPos(ys[k], "y", true)));
  };
  const inside = (u, draw) => {
    const {ctx, bbox} = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    draw(ctx, devicePixelRatio || 1);
    ctx.restore();
  };
  const drawBands = chart => u => inside(u, ctx => {
    for (const band of chart.bands) {
      path(u, [...band.x, ...band.x.slice().reverse()], [...band.lower, ...band.upper.slice().reverse()]);
      ctx.globalAlpha = 0.2;
      ctx.fillStyle = colour(band.colour);
      ctx.fill();
    }
  });
  const drawMarks = chart => u => inside(u, (ctx, ratio) => {
    for (const mark of chart.marks) {
      const x = u.valToPos(mark.x, "x", true), y = u.valToPos(mark.y, "y", true);
      const left = x < u.bbox.left + u.bbox.width / 2;
      const high = Math.min(Math.max(y + 4 * ratio, u.bbox.top + 14 * ratio), u.bbox.top + u.bbox.height - 23 * ratio);
      ctx.strokeStyle = ctx.fillStyle = rooted("--ink");
      ctx.lineWidth = 1.5 * ratio;
      ctx.beginPath();
      ctx.arc(x, y, 6 * ratio, 0, 2 * Math.PI);
      ctx.stroke();
      ctx.font = `600 ${13 * ratio}px system-ui, sans-serif`;
      ctx.textAlign = left ? "left" : "right";
      ctx.strokeStyle = rooted("--paper");
      ctx.lineWidth = 4 * ratio;
      const at = x + (left ? 12 : -12) * ratio;
      const room = left ? u.bbox.left + u.bbox.width - at : at - u.bbox.left;
      [mark.text, mark.more].filter(text => ctx.measureText(text).width < room).forEach((text, k) => {
        ctx.strokeText(text, at, high + 17 * k * ratio);
        ctx.fillText(text, at, high + 17 * k * ratio);
      });
    }
  });
  const number = value => value == null ? "–" : String(+value.toPrecision(4)).replace("-", "−");
  const seriesOf = one => {
    const stroke = colour(one.colour), dots = one.style === "dots";
    return {stroke, width: dots ? 0 : 1.6, dash: one.style === "dashes" ? [5, 4] : undefined, spanGaps: false,
            paths: dots ? () => null : undefined, points: {show: dots, size: one.few ? 8 : 4, width: 0, fill: stroke}};
  };
  const read = (u, fields) => u.cursor.idxs.slice(1).forEach((at, k) => {
    const value = at == null ? null : u.data[k + 1][at];
    fields[k].textContent = value == null ? "" : number(value);
  });
  // The legend names what is in view.
  const listSeen = (chart, entries, {min, max}) => chart.series.forEach((one, k) => {
    entries[k].hidden = !one.x.some((x, j) => one.y[j] != null && x >= min && x <= max);
  });
  const axisOf = (label, size) => ({label, size, labelSize: 20, stroke: rooted("--ink"), grid: {stroke: rooted("--line"), width: 1}, ticks: {stroke: rooted("--line")},
    font: "12px system-ui, sans-serif", labelFont: "13px system-ui, sans-serif", values: (u, at) => at.map(number)});
  const build = chart => {
    const home = find(`chart-${chart.id}`).querySelector(".plot");
    const size = () => ({width: Math.max(200, home.clientWidth), height: 230});
    const high = chart.bands.flatMap(band => [...band.lower, ...band.upper]).filter(value => value != null);
    const range = (u, low, top) => {
      const ends = [low, top, ...high].filter(value => value != null);
      const [a, b] = [Math.min(...ends), Math.max(...ends)], free = 0.05 * (b - a || 1);
      return [a - free, b + free];
    };
    const plot = new uPlot({
      ...size(), scales: {x: {time: false}, y: {range}}, legend: {show: false}, series: [{}, ...chart.series.map(seriesOf)],
      axes: [axisOf(chart.labels[0], 34), axisOf(chart.labels[1], 58)],
      cursor: {points: {size: 8}, y: false, drag: {x: true, y: false}, sync: chart.overTime ? {key: "time", scales: ["x", null]} : undefined},
      hooks: {drawAxes: [drawBands(chart)], draw: [drawMarks(chart)],
        setCursor: [u => read(u, home.parentNode.querySelectorAll(".read")), u => { if (film && chart.overTime && u.cursor.event && u.cursor.left >= 0) show(nearest(u.posToVal(u.cursor.left, "x")), "chart"); }],
        setScale: [(u, key) => { if (key === "x" && chart.overTime) zoomAll(u); },
          (u, key) => { if (key === "x") listSeen(chart, home.parentNode.querySelectorAll(".legend li"), u.scales.x); }]},
    }, uPlot.join(chart.series.map(one => [one.x, one.y])), home);
    plot.overTime = chart.overTime;
    if (chart.reach) plot.setScale("x", {min: chart.reach[0], max: chart.reach[1]});
    plot.refit = () => plot.setSize(size());
    return plot;
  };
  let zooming = true;  // until all charts are there, none follows another
  const zoomAll = source => {
    if (zooming) return;
    zooming = true;
    for (const plot of plots) if (plot !== source && plot.overTime) plot.setScale("x", {min: source.scales.x.min, max: source.scales.x.max});
    zooming = false;
  };
  const draw = () => {
    for (const plot of plots.splice(0)) plot.destroy();
    zooming = true;
    for (const chart of charts) plots.push(build(chart));
    setTimeout(() => { zooming = false; });
  };

  root.classList.add("js");
  draw();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  addEventListener("resize", () => { for (const plot of plots) plot.refit(); });
  if (film) {
    find("play").addEventListener("click", play);
    find("scrub").addEventListener("input", event => show(+event.target.value));
  }
})();
