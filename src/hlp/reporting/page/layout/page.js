"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const at = id => document.getElementById(id);
  const body = at("list").tBodies[0], heads = [...at("list").tHead.rows[0].cells];
  const KEY = 3, VERDICT = 4, WORDS = new Set([2, 4, 5]), MOST = 500;
  let order = [VERDICT, -1], shown = [], opened = null;
  const picture = row => data.pictures[row[KEY]];
  heads.forEach((head, i) => { if (WORDS.has(i)) head.className = "words"; });

  const compare = (a, b) => a === b ? 0 : a === null ? 1 : b === null ? -1 : a < b ? -1 : 1;
  const sorted = rows => {
    const [column, sign] = order;
    return [...rows].sort((a, b) => a[column] === null || b[column] === null
      ? compare(a[column], b[column]) : sign * compare(a[column], b[column]));
  };
  function list() {
    const words = at("filter").value.toLowerCase().split(/\s+/).filter(Boolean);
    shown = sorted(data.rows.filter(row => (!at("pictured").checked || picture(row)) &&
      words.every(word => row.some((cell, i) => i !== KEY && String(cell ?? "").toLowerCase().includes(word)))));
    heads.forEach((head, i) => head.setAttribute("aria-sort", i !== order[0] ? "none" : order[1] > 0 ? "ascending" : "descending"));
    body.replaceChildren(...shown.slice(0, MOST).map(line));
    const cut = shown.length > MOST ? ` (the first ${MOST} are listed)` : "";
    at("count").textContent = `${shown.length} of ${data.rows.length} targets${cut}`;
  }
  function line(row) {
    const tr = document.createElement("tr");
    row.forEach((cell, i) => {
      const td = tr.insertCell();
      td.textContent = i === KEY ? (picture(row) ? "▣" : "") :
        typeof cell === "number" ? cell.toFixed(data.digits[i]) : cell ?? "–";
      if (WORDS.has(i)) td.className = i === VERDICT && cell !== "right" ? "words wrong" : "words";
    });
    tr.row = row;
    tr.tabIndex = 0;
    tr.onclick = () => look(row);
    tr.onkeydown = event => {
      const next = { ArrowDown: tr.nextElementSibling, ArrowUp: tr.previousElementSibling }[event.key];
      if (event.key === "Enter") look(row);
      if (next) { event.preventDefault(); next.focus(); look(next.row, false); }
    };
    mark(tr);
    return tr;
  }
  const mark = tr => tr.row === opened ? tr.setAttribute("aria-current", "true") : tr.removeAttribute("aria-current");
  heads.forEach((head, i) => { if (i !== KEY) head.firstElementChild.onclick = () => {
    order = [i, order[0] === i ? -order[1] : 1];
    list();
  }; });
  at("csv").onclick = () => {
    const cell = value => /[",\n]/.test(value ?? "") ? `"${String(value).replaceAll('"', '""')}"` : value ?? "";
    const lines = [heads.map((head, i) => i === KEY ? "target" : head.textContent), ...shown];
    const text = lines.map(line => line.map(cell).join(",") + "\n").join("");
    at("csv").href = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
  };
  at("filter").oninput = list;
  at("pictured").onchange = list;
  at("close").onclick = () => {
    at("look").hidden = true;
    opened = null;
    [...body.rows].forEach(mark);
  };

  function look(row, scroll = true) {
    opened = row;
    [...body.rows].forEach(mark);
    at("look").hidden = false;
    at("name").textContent = `${row[2]} in image ${row[1]} of scene ${row[0]}: ${row[VERDICT]}` +
      (row[5] ? `, ${row[5]}` : "");
    at("name").href = "#" + row[KEY];
    at("seen").hidden = !picture(row);
    if (picture(row)) at("picture").src = "data:image/jpeg;base64," + picture(row);
    show(picture(row) && data.scenes.targets[row[KEY]]);
    if (scroll) at("look").scrollIntoView({ behavior: "smooth", block: "nearest" });
  }

  // The 3D view: points and lines, far ones first; x to the right, y down, z away, as in the camera.
  const canvas = at("view"), pen = canvas.getContext("2d");
  let scene = null, yaw = 0, pitch = 0, zoom = 1;
  const bytes = text => Uint8Array.from(atob(text), each => each.charCodeAt(0));
  function show(target) {
    at("turning").hidden = !target;
    if (!target) return;
    const model = data.scenes.models[target.object];
    const moved = pose => model.vertices.map(v => [0, 1, 2].map(i => pose[4 * i] * v[0] +
      pose[4 * i + 1] * v[1] + pose[4 * i + 2] * v[2] + pose[4 * i + 3] - target.middle[i]));
    scene = {
      points: new Int16Array(bytes(target.points).buffer), colors: bytes(target.colors),
      edges: model.edges, truth: moved(target.truth),
      found: target.estimate ? moved(target.estimate) : null,
    };
    // A ball about both poses, in the middle: it is within the canvas from all sides.
    const all = [...scene.truth, ...scene.found ?? []];
    scene.center = [0, 1, 2].map(i => (Math.min(...all.map(v => v[i])) + Math.max(...all.map(v => v[i]))) / 2);
    scene.radius = 1.05 * Math.max(...all.map(v => Math.hypot(...v.map((x, i) => x - scene.center[i]))));
    yaw = 0.5; pitch = -0.35; zoom = 1;
    draw();
  }
  function draw() {
    const { width, height } = canvas, size = zoom * Math.min(width, height) / 2 / scene.radius;
    const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    const [mx, my, mz] = scene.center;
    const place = (x, y, z) => {
      x -= mx; y -= my; z -= mz;
      const across = cy * x + sy * z, away = cy * z - sy * x;
      const down = cp * y - sp * away, depth = sp * y + cp * away;
      const near = 1 / (1 + depth / (6 * scene.radius));
      return [width / 2 + size * near * across, height / 2 + size * near * down, depth];
    };
    pen.clearRect(0, 0, width, height);
    if (at("cloud").checked) {
      const dots = [];
      for (let i = 0; i < scene.points.length; i += 3) {
        dots.push([...place(scene.points[i] / 10, scene.points[i + 1] / 10, scene.points[i + 2] / 10), i]);
      }
      dots.sort((a, b) => b[2] - a[2]);
      const c = scene.colors, side = 4 * Math.max(0.6, zoom);
      for (const [x, y, , i] of dots) {
        pen.fillStyle = `rgb(${c[i]},${c[i + 1]},${c[i + 2]})`;
        pen.fillRect(x, y, side, side);
      }
    }
    // The colours of the pictures (figures/panels.py), which colour-blind readers can tell apart.
    wires(scene.truth, "rgba(255,165,0,.75)", place);
    if (scene.found) wires(scene.found, "rgba(86,180,233,.75)", place);
  }
  function wires(vertices, color, place) {
    const placed = vertices.map(v => place(...v));
    pen.strokeStyle = color;
    pen.lineWidth = 1;
    pen.beginPath();
    for (const [a, b] of scene.edges) {
      pen.moveTo(placed[a][0], placed[a][1]);
      pen.lineTo(placed[b][0], placed[b][1]);
    }
    pen.stroke();
  }
  const held = new Map();  // places of the mouse, or of fingers
  const apart = () => { const [[a, b], [c, d]] = held.values(); return Math.hypot(a - c, b - d) || 1; };
  canvas.onpointerdown = event => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, [event.clientX, event.clientY]);
  };
  canvas.onpointerup = canvas.onpointercancel = event => held.delete(event.pointerId);
  canvas.onpointermove = event => {
    const before = held.get(event.pointerId);
    if (!before) return;
    const last = held.size === 2 ? apart() : 0;
    held.set(event.pointerId, [event.clientX, event.clientY]);
    if (held.size === 2) zoom *= apart() / last;
    else {
      yaw -= (event.clientX - before[0]) / 120;
      pitch = Math.max(-1.5, Math.min(1.5, pitch + (event.clientY - before[1]) / 120));
    }
    draw();
  };
  canvas.onwheel = event => { event.preventDefault(); zoom *= Math.exp(-event.deltaY / 600); draw(); };
  at("cloud").onchange = () => draw();

  const linked = () => data.rows.find(row => "#" + row[KEY] === location.hash);
  onhashchange = () => { if (linked()) look(linked()); };
  list();
  const first = linked() ?? shown.find(picture);
  if (first) look(first, first === linked());
})();
