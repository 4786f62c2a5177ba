// SPDX-License-Identifier: Apache-2.0
(() => {
  const root = document.documentElement, hidden = new Set(), sheet = document.createElement("style");
  document.head.append(sheet);
  const quoted = (m) => `[data-m="${CSS.escape(m)}"]`;
  const all = (query, from = document) => [...from.querySelectorAll(query)];

  // --- light or dark ---
  const theme = document.querySelector(".theme");
  const dark = () => root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  const say = () => { theme.textContent = dark() ? "Light" : "Dark"; theme.setAttribute("aria-label", `Switch to ${dark() ? "light" : "dark"}`); };
  theme.hidden = false;
  theme.onclick = () => { root.dataset.theme = dark() ? "light" : "dark"; say(); };
  say();

  // --- which methods are shown, and whose band ---
  let focus = root.dataset.focus || "";
  const paint = (over) => {
    const shown = over || focus;
    sheet.textContent = [...hidden].map((m) => `main ${quoted(m)}{display:none}`).join("") +
      (shown ? `svg.chart .band${quoted(shown)}{opacity:.17}` : "") +
      (over ? `svg.chart:has(${quoted(over)}) :is(.ln,.dot,.reach):not(${quoted(over)}){opacity:.18}` : "");
  };
  for (const key of all(".keys button")) {
    const m = key.dataset.key;
    key.onclick = () => {
      hidden.has(m) ? hidden.delete(m) : hidden.add(m);
      key.setAttribute("aria-pressed", String(!hidden.has(m)));
      paint();
    };
    key.onpointerenter = (e) => { if (e.pointerType === "mouse" && !hidden.has(m)) paint(m); };
    key.onpointerleave = () => paint();
  }
  paint();

  // --- sorting ---
  for (const button of all("thead .sort")) button.onclick = () => {
    const head = button.parentElement, body = head.closest("table").tBodies[0];
    const column = head.cellIndex, up = head.getAttribute("aria-sort") === "descending";
    all("th[aria-sort]", head.parentElement).forEach((h) => h.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const of = (row) => {
      const cell = row.cells[column];
      return cell.dataset.v === undefined ? null : Number(cell.dataset.v);
    };
    const rows = [...body.rows], numeric = rows.some((r) => of(r) !== null);
    rows.sort((a, b) => {
      if (!numeric) return (up ? -1 : 1) * a.cells[column].textContent.localeCompare(b.cells[column].textContent);
      const x = of(a), y = of(b);
      if (x === null || y === null) return (x === null) - (y === null);
      return up ? x - y : y - x;
    });
    body.append(...rows);
  };

  // --- values under the pointer ---
  const tip = document.createElement("div");
  tip.className = "tip"; tip.hidden = true; document.body.append(tip);
  const place = (e) => {
    const w = tip.offsetWidth, h = tip.offsetHeight;
    tip.style.left = `${Math.max(6, Math.min(e.clientX + 14, innerWidth - w - 8))}px`;
    tip.style.top = `${Math.max(6, e.clientY + h + 22 > innerHeight ? e.clientY - h - 12 : e.clientY + 14)}px`;
  };
  const axis = (text) => {
    const [kind, low, high, a, b, unit] = text.split(",");
    const bend = { log: Math.log10, root: Math.sqrt, linear: (v) => v }[kind];
    const back = { log: (v) => 10 ** v, root: (v) => v * v, linear: (v) => v }[kind];
    const [l, h] = [bend(+low), bend(+high)];
    return { unit, at: (px) => back(l + (h - l) * (px - a) / (b - a)), min: Math.min(a, b), max: Math.max(a, b) };
  };
  const write = (v, unit) => {
    if (unit === "%") return `${(100 * v).toFixed(v > 0 && v < .0995 ? 2 : 1)} %`;
    const s = Math.abs(v) >= 100 ? v.toFixed(0) : Number(v.toPrecision(3)).toString();
    return unit ? `${s} ${unit}` : s;
  };
  const points = new WeakMap();
  const of = (path) => {
    if (!points.has(path)) points.set(path, [...path.getAttribute("d").matchAll(/([\d.]+),([\d.]+)/g)].map((p) => [+p[1], +p[2]]));
    return points.get(path);
  };
  for (const chart of all("svg.chart")) {
    const lines = all(".ln", chart);
    if (!lines.length) continue;
    const x = axis(chart.dataset.x), y = axis(chart.dataset.y);
    let cursor;
    chart.addEventListener("pointermove", (e) => {
      const box = chart.getBoundingClientRect(), scale = chart.viewBox.baseVal.width / box.width;
      const px = (e.clientX - box.left) * scale;
      if (px < x.min - 2 || px > x.max + 2) { tip.hidden = true; cursor?.remove(); return; }
      const rows = [];
      for (const line of lines) {
        if (hidden.has(line.dataset.m)) continue;
        let best = null;
        for (const p of of(line)) if (!best || Math.abs(p[0] - px) < Math.abs(best[0] - px)) best = p;
        if (best && Math.abs(best[0] - px) < 9) rows.push([line.dataset.name || line.dataset.m, y.at(best[1]), line]);
      }
      if (!rows.length) { tip.hidden = true; cursor?.remove(); return; }
      cursor ||= document.createElementNS("http://www.w3.org/2000/svg", "path");
      cursor.setAttribute("class", "cursor");
      cursor.setAttribute("d", `M${px.toFixed(1)},${y.min}V${y.max}`);
      chart.append(cursor);
      const head = document.createElement("b");
      head.textContent = `${chart.dataset.xl}: ${write(x.at(px), x.unit)}`;
      tip.replaceChildren(head, ...rows.sort((a, b) => b[1] - a[1]).map(([name, value, line]) => {
        const row = document.createElement("div"), left = document.createElement("span"), right = document.createElement("span");
        const key = document.querySelector(`.keys ${`[data-key="${CSS.escape(line.dataset.m)}"]`} svg.key`);
        if (key) left.append(key.cloneNode(true));
        left.append(name); right.textContent = write(value, y.unit);
        row.append(left, right); return row;
      }));
      tip.hidden = false; place(e);
    });
    chart.addEventListener("pointerleave", () => { tip.hidden = true; cursor?.remove(); });
  }

  // --- where one is ---
  const links = new Map(all("nav.contents a").map((a) => [a.getAttribute("href").slice(1), a]));
  const watch = new IntersectionObserver((entries) => entries.forEach((e) => {
    if (e.isIntersecting) { links.forEach((a) => a.classList.remove("here")); links.get(e.target.id)?.classList.add("here"); }
  }), { rootMargin: "-10% 0px -80% 0px" });
  all("section[id]").forEach((s) => watch.observe(s));
})();
