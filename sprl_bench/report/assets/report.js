"use strict";
// Switches, sorting, downloads and refreshing. The charts are Vega-Lite's: here they get their data.
(() => {
  const one = (selector, root = document) => root.querySelector(selector);
  const all = (selector, root = document) => [...root.querySelectorAll(selector)];
  const MOST_SINGLE = 1000; // runs that are drawn as thin lines from the start
  const views = new Map(); // of each chart's element
  const shapes = new WeakMap(); // of each view
  const near = new Set(); // charts in view, or almost
  const stale = new Set(); // charts that do not show what they should
  const off = new Set(); // names of agents that are switched off
  const orders = new Map(); // of each table: its column and direction
  let data = JSON.parse(one("#data").textContent);
  let lit = "";
  let pointed = null; // the chart below the pointer, or the last that was
  let settled = Promise.resolve(); // charts are drawn one after the other

  // Agents

  const byName = (name) => data.agents.find((agent) => agent.name === name);
  const isShown = (name) => !off.has(name) && (byName(name).ordinary || !one("#ordinary").checked);

  function showAgents() {
    for (const box of all("input[data-agent]")) box.checked = !off.has(data.agents[box.dataset.agent].name);
    for (const row of all("tr[data-agent], details[data-agent]")) row.hidden = !isShown(data.agents[row.dataset.agent].name);
    for (const item of all("nav li")) {
      const { ordinary } = data.agents[one("input", item).dataset.agent];
      item.hidden = one("#ordinary").checked && !ordinary;
    }
    for (const select of all('select[data-choice="reference"]')) chooseShown(select);
  }

  // The reference of a comparison is an agent that is shown, if there is one.
  function chooseShown(select) {
    const options = all("option", select);
    for (const option of options) option.disabled = option.hidden = !isShown(data.agents[option.value].name);
    if (!select.selectedOptions[0]?.disabled) return;
    select.value = (options.find((option) => !option.disabled) ?? select.selectedOptions[0]).value;
  }

  function lightUp(name) {
    if (name === lit) return;
    lit = name;
    for (const item of all("nav li, tr[data-agent]")) {
      const index = item.dataset.agent ?? one("input", item).dataset.agent;
      item.classList.toggle("lit", data.agents[index].name === name);
    }
    for (const [chart, view] of views) {
      view.signal("highlight", name);
      if (near.has(chart)) view.runAsync(); // the others when they come into view
    }
  }

  // Charts

  const span = (low, high) => (low == null ? "-" : `[${low}, ${high}]`);

  // A single seed has a point and no interval; its line of no length keeps its row in the order of the others.
  const whisker = (x, low, high) => ({ x, low: low ?? x, high: high ?? x, interval: span(low, high) });

  function lines(items, xs, withRuns) {
    const rows = { means: [], bands: [], runs: [] };
    for (const { agent, mean, low, high, runs, seeds } of items) {
      mean.forEach((y, i) => {
        if (y == null) return;
        const row = { agent, label: byName(agent).label, x: xs[i], y, interval: span(low?.[i], high?.[i]) };
        rows.means.push(row);
        if (low) rows.bands.push({ ...row, low: low[i], high: high[i] });
      });
      if (!withRuns || runs.length < 2) continue;
      runs.forEach((values, s) => values.forEach((y, i) => {
        if (y != null) rows.runs.push({ agent, run: `${seeds[s]} ${agent}`, x: xs[i], y });
      }));
    }
    return rows;
  }

  const steps = (budget, bins) => Array.from({ length: bins }, (_, i) => (budget * (i + 1)) / bins);
  const choice = (chart, name) => one(`[data-choice="${name}"]`, chart.closest("section")).value;

  const titleOf = (chart, name) => one(`[data-choice="${name}"]`, chart.closest("section")).selectedOptions[0].text;

  const kinds = {
    curve(chart) {
      const section = data.sections[chart.dataset.section];
      const task = section.tasks[chart.dataset.task];
      if (!task.budget) return { rows: lines([], [], false), empty: "No run of this task is finished." };
      const items = section.curves.filter((curve) => curve.task === +chart.dataset.task && isShown(curve.agent));
      return {
        rows: lines(items, steps(task.budget, 100), one("#single").checked),
        name: `Learning curves on ${task.name}`,
        x: [0, task.budget],
        y: task.range,
      };
    },
    metric(chart) {
      const { panels, names, bins } = data.metrics;
      const panel = panels[chart.dataset.task];
      const metric = +one("#metric").value;
      const items = data.metrics.lines.filter(
        (line) => line.metric === metric && line.panel === +chart.dataset.task && isShown(line.agent)
      );
      return {
        rows: lines(items, steps(panel.budget, bins), one("#single").checked),
        name: `${names[metric]} on ${panel.task}`,
        title: names[metric],
        x: [0, panel.budget],
      };
    },
    profile(chart) {
      const items = data.sections[chart.dataset.section].profiles.filter((item) => isShown(item.agent));
      const xs = items.length ? items[0].mean.map((_, i, mean) => i / (mean.length - 1)) : [];
      const whole = items.map((item) => ({ ...item, runs: [] }));
      return { rows: lines(whole, xs, false), name: "Performance profiles", x: [0, 1], y: [0, 1] };
    },
    interval(chart) {
      const section = data.sections[chart.dataset.section];
      const [measure, task] = [choice(chart, "measure"), +choice(chart, "task")];
      const means = section.estimates
        .filter((line) => line.measure === measure && line.task === task && isShown(line.agent))
        .map((line) => ({ ...whisker(line.value, line.low, line.high), agent: line.agent, label: byName(line.agent).label }));
      const column = data.seed_columns.indexOf(measure);
      const taskName = section.tasks[task]?.name;
      const runs = data.seeds
        .filter((row) => column > 0 && row[0] === section.suite && row[1] === taskName && isShown(row[2]))
        .map((row) => ({ agent: row[2], label: byName(row[2]).label, x: row[column] }));
      means.sort((a, b) => b.x - a.x);
      return { rows: { means, runs }, name: `Intervals of ${measure}`, title: titleOf(chart, "measure") };
    },
    improvement(chart) {
      const section = data.sections[chart.dataset.section];
      const reference = data.agents[choice(chart, "reference")].name;
      const means = section.improvements
        .filter((line) => line[1] === reference && isShown(line[0]))
        .map(([agent, , x, low, high]) => ({ ...whisker(x, low, high), agent, label: byName(agent).label }));
      means.sort((a, b) => b.x - a.x);
      return { rows: { means }, name: `Probability of improvement over ${byName(reference).label}` };
    },
  };

  function described({ name, rows }) {
    const last = new Map(rows.means.map((row) => [row.label, row.y ?? row.x]));
    return `${name}. ${[...last].map(([agent, value]) => `${agent}: ${value}`).join("; ") || "No agent is shown"}.`;
  }

  const hasLines = (chart) => !["interval", "improvement"].includes(chart.dataset.kind);
  const isFixed = (chart) => ["curve", "profile"].includes(chart.dataset.kind); // its axes, whatever the rows

  // A layer without rows would spoil an axis that follows the rows.
  function layersOf(chart, { rows }) {
    return data.specs[chart.dataset.kind].layer.filter((layer) => isFixed(chart) || rows[layer.data.name]?.length !== 0);
  }

  // What a chart was drawn for: while that is the same, its rows can be changed.
  function shapeOf(chart, content) {
    const layers = layersOf(chart, content).map((layer) => layer.data.name);
    return JSON.stringify(hasLines(chart) ? [content.name, layers, !content.rows.means.length] : content);
  }

  function specOf(chart, content) {
    const spec = structuredClone({ ...data.specs[chart.dataset.kind], layer: layersOf(chart, content) });
    spec.description = described(content);
    spec.datasets = { ...content.rows, points: [] };
    spec.params = [{ name: "highlight", value: lit }];
    for (const { encoding } of spec.layer) {
      if (content.x && encoding.x?.field === "x") encoding.x.scale = { ...encoding.x.scale, domain: content.x };
      if (content.y && encoding.y) encoding.y.scale = { ...encoding.y.scale, domain: content.y };
      const value = content.y || chart.dataset.kind !== "interval" ? encoding.y : encoding.x;
      if (content.title && value?.axis) value.axis.title = content.title;
    }
    return spec;
  }

  async function draw(chart, content) {
    views.get(chart)?.finalize();
    views.delete(chart);
    chart.style.minHeight = "";
    if (chart === pointed) pointed = null;
    const empty = content.empty ?? (content.rows.means.length ? "" : "No agent that is shown has a finished run here.");
    chart.classList.toggle("empty", empty !== "");
    chart.textContent = empty;
    if (empty) return;
    const { view } = await vegaEmbed(chart, specOf(chart, content), {
      actions: { export: true, source: false, compiled: false, editor: false },
      ast: true, // nothing is compiled from text, so that the page's policy may forbid it
      downloadFileName: content.name,
      logLevel: vega.Error, // a chart as high as its rows warns that its height is not fitted
      mode: "vega-lite",
      renderer: "svg",
    });
    views.set(chart, view);
    shapes.set(view, shapeOf(chart, content));
    const menu = one("summary", chart);
    if (menu) menu.setAttribute("aria-label", `Save the chart: ${content.name}`);
    if (hasLines(chart)) view.addSignalListener("hover", (_, value) => lightUp(value.agent?.[0] ?? ""));
    else view.addEventListener("pointerover", (_, item) => lightUp(item?.datum?.agent ?? ""));
  }

  // Rows of agents that stay are left alone: what an agent has in a chart never changes while the chart is there.
  function changed(before, after) {
    const [had, has] = [before, after].map((rows) => new Set(rows.map((row) => row.agent)));
    return vega.changeset().remove((row) => !has.has(row.agent)).insert(after.filter((row) => !had.has(row.agent)));
  }

  async function update(chart) {
    stale.delete(chart);
    const content = kinds[chart.dataset.kind](chart);
    const view = views.get(chart);
    if (!view || shapes.get(view) !== shapeOf(chart, content)) return draw(chart, content);
    if (!hasLines(chart)) return view.runAsync(); // the shape holds the rows
    const points = chart === pointed ? content.rows.means.map((row) => ({ ...row })) : [];
    const rows = { ...content.rows, points };
    for (const { data: { name } } of layersOf(chart, content)) view.change(name, changed(view.data(name), rows[name]));
    view.description(described(content));
    return view.runAsync();
  }

  // The points that a pointer finds are nine in ten of a chart's elements: only one chart has them.
  function pointAt(chart) {
    if (chart === pointed || !views.has(chart) || !hasLines(chart)) return;
    views.get(pointed)?.data("points", []).runAsync();
    pointed = chart;
    views.get(chart).data("points", kinds[chart.dataset.kind](chart).rows.means).runAsync();
  }

  // A large report has dozens of charts: each is drawn when it comes into view, and the rest when the page is printed.
  const observer = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      isIntersecting ? near.add(target) : near.delete(target);
      if (isIntersecting) views.get(target)?.runAsync();
    }
    drawNear();
  }, { rootMargin: "25% 0px" });

  function refreshCharts(charts = all(".chart")) {
    for (const chart of charts) stale.add(chart);
    drawNear();
  }

  function drawNear() {
    document.body.dataset.charts = "drawing";
    settled = settled.then(async () => {
      for (let chart = nextChart(); chart; chart = nextChart()) {
        await update(chart);
        await new Promise((next) => setTimeout(next)); // the page answers in between
      }
    }).catch((error) => console.error(error)).then(() => {
      document.body.dataset.charts = "drawn";
    });
  }

  function nextChart() {
    const distance = (chart) => Math.abs(chart.getBoundingClientRect().top - innerHeight / 3);
    return [...stale].filter((chart) => near.has(chart)).sort((a, b) => distance(a) - distance(b))[0];
  }

  // Tables

  function sort(table, column, direction) {
    orders.set(table.id, [column, direction]);
    const body = one("tbody", table);
    const key = (row) => {
      const cell = row.cells[column];
      return "value" in cell.dataset ? (cell.dataset.value === "" ? NaN : +cell.dataset.value) : cell.textContent;
    };
    const sign = direction === "ascending" ? 1 : -1;
    const compare = (a, b) => {
      const [x, y] = [key(a), key(b)];
      if (typeof x === "string") return sign * x.localeCompare(y);
      return Number.isNaN(x) || Number.isNaN(y) ? Number.isNaN(x) - Number.isNaN(y) : sign * (x - y);
    };
    body.append(...[...body.rows].sort(compare));
    all("thead th", table).forEach((head, i) => head.setAttribute("aria-sort", i === column ? direction : "none"));
  }

  function sortBy(button) {
    const head = button.closest("th");
    const now = head.getAttribute("aria-sort");
    const first = head.cellIndex === 0 ? "ascending" : "descending";
    const other = first === "ascending" ? "descending" : "ascending";
    sort(head.closest("table"), head.cellIndex, now === first ? other : first);
  }

  function fillSeeds() {
    const place = one("#seeds .scroll");
    if (!one("#seeds").open || place.firstChild) return;
    const table = document.createElement("table");
    const row = (cells, parent, tag) => {
      const line = parent.insertRow();
      cells.forEach((cell, i) => {
        const element = line.appendChild(document.createElement(tag(i)));
        element.textContent = cell ?? "-";
        if (tag(i) === "th") element.scope = parent.tagName === "THEAD" ? "col" : "row";
        if (typeof cell === "number") element.className = "number";
      });
      return line;
    };
    row(data.seed_columns.map((name) => name.replaceAll("_", " ")), table.createTHead(), () => "th");
    const body = table.createTBody();
    for (const cells of data.seeds) {
      const line = row(cells, body, (i) => (i === 2 ? "th" : "td"));
      line.dataset.agent = data.agents.findIndex((agent) => agent.name === cells[2]);
    }
    place.append(table);
    showAgents();
  }

  // Downloads

  const quoted = (value) => {
    if (value == null) return "";
    const text = String(value);
    return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  const csv = (rows) => rows.map((row) => row.map(quoted).join(",")).join("\n") + "\n";

  const downloads = {
    scores: () => [
      ["suite", "task", "agent", "measure", "value", "low", "high", "seeds"],
      ...data.sections.flatMap((section) => section.estimates.map((line) => [
        section.suite, section.tasks[line.task]?.name ?? "all", line.agent, line.measure, line.value, line.low,
        line.high, line.seeds,
      ])),
    ],
    seeds: () => [data.seed_columns, ...data.seeds],
    curves: () => [
      ["suite", "task", "agent", "seed", "env_steps", "return"],
      ...data.sections.flatMap((section) => section.curves.flatMap(({ task, agent, seeds, runs }) => {
        const { name, budget } = section.tasks[task];
        const xs = steps(budget, 100);
        return runs.flatMap((run, s) => run.map((value, i) => [section.suite, name, agent, seeds[s], xs[i], value]));
      })),
    ],
    metrics: () => [
      ["suite", "task", "agent", "metric", "env_steps", "mean"],
      ...data.metrics.lines.flatMap(({ metric, panel, agent, mean }) => {
        const { suite, task, budget } = data.metrics.panels[panel];
        const xs = steps(budget, data.metrics.bins);
        return mean.map((value, i) => [suite, task, agent, data.metrics.names[metric], xs[i], value]);
      }),
    ],
  };

  function download(name) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([csv(downloads[name]())], { type: "text/csv" }));
    link.download = `${name}.csv`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
  }

  // News from the server, for a page that is served while runs go on

  function remembered() {
    const choices = all("select").map((select, i) => [i, select.value]);
    const open = new Map(all("main details[data-key]").map((item) => [item.dataset.key, item.open]));
    return { choices, open };
  }

  function restore({ choices, open }) {
    const selects = all("select");
    for (const [i, value] of choices) {
      if (selects[i] && all("option", selects[i]).some((option) => option.value === value)) selects[i].value = value;
    }
    for (const item of all("main details[data-key]")) item.open = open.get(item.dataset.key) ?? item.open;
    for (const [id, order] of orders) {
      const table = document.getElementById(id);
      if (table) sort(table, ...order);
    }
  }

  function replaceBy(page) {
    const state = remembered();
    const [ordinary, single] = [one("#ordinary").checked, one("#single").checked];
    const heights = all(".chart").map((chart) => chart.offsetHeight);
    for (const view of views.values()) view.finalize();
    for (const known of [views, near, stale]) known.clear();
    observer.disconnect();
    data = JSON.parse(one("#data", page).textContent);
    for (const id of ["#main", "#agents"]) one(id).replaceWith(document.adoptNode(one(id, page)));
    all(".chart").forEach((chart, i) => { chart.style.minHeight = `${heights[i] ?? 0}px`; });
    [one("#ordinary").checked, one("#single").checked] = [ordinary, single];
    restore(state);
    prepare();
  }

  async function poll(last) {
    let now = last;
    try {
      const answer = await fetch("/", { cache: "no-cache" });
      if (!answer.ok) throw new Error(answer.statusText);
      now = await answer.text();
      if (last && now !== last) replaceBy(new DOMParser().parseFromString(now, "text/html"));
      one("#live").textContent = "Live.";
    } catch {
      one("#live").textContent = "The server does not answer.";
    }
    setTimeout(poll, 1000 * +document.body.dataset.refresh, now);
  }

  // Events

  function prepare() {
    for (const dot of all(".dot")) dot.style.background = dot.dataset.colour;
    showAgents();
    one("#seeds").addEventListener("toggle", fillSeeds);
    fillSeeds();
    const charts = all(".chart");
    document.body.dataset.charts = charts.length ? "drawing" : "drawn";
    for (const chart of charts) {
      stale.add(chart);
      observer.observe(chart);
    }
  }

  document.addEventListener("click", ({ target }) => {
    const button = target.closest("button");
    if (!button) return;
    if (button.closest(".sortable")) sortBy(button);
    if (button.dataset.download) download(button.dataset.download);
    if (button.dataset.all) {
      for (const agent of data.agents) button.dataset.all === "on" ? off.delete(agent.name) : off.add(agent.name);
      showAgents();
      refreshCharts();
    }
  });

  document.addEventListener("change", ({ target }) => {
    if (target.dataset.agent) {
      const { name } = data.agents[target.dataset.agent];
      target.checked ? off.delete(name) : off.add(name);
    }
    const section = target.dataset.choice && target.closest("section");
    const kind = target.dataset.choice === "reference" ? "improvement" : "interval";
    if (section) refreshCharts(all(`[data-kind="${kind}"]`, section));
    else if (target.id === "metric") refreshCharts(all('[data-kind="metric"]'));
    else {
      showAgents();
      refreshCharts();
    }
  });

  document.addEventListener("pointerover", ({ target }) => {
    const item = target.closest?.("nav li, tr[data-agent]");
    if (item) lightUp(data.agents[item.dataset.agent ?? one("input", item).dataset.agent].name);
    const chart = target.closest?.(".chart");
    if (chart) pointAt(chart);
    else if (!item) lightUp("");
  });

  // A page around this one, such as that of a site, may choose light or dark, and nothing else.
  addEventListener("message", ({ source, data: message }) => {
    const theme = message?.theme;
    if (source === parent && ["light", "dark", "auto"].includes(theme)) document.documentElement.dataset.theme = theme;
  });

  let wasOpen = true; // the list of agents is the legend, which paper needs
  addEventListener("beforeprint", () => {
    wasOpen = one("#agents details").open;
    one("#agents details").open = true;
    for (const chart of stale) update(chart);
  });
  addEventListener("afterprint", () => { one("#agents details").open = wasOpen; });

  one("#single").checked = data.seeds.length <= MOST_SINGLE;
  if (matchMedia("(max-width: 48rem)").matches) one("#agents details").open = false;
  prepare();
  if (+document.body.dataset.refresh) setTimeout(poll, 1000 * +document.body.dataset.refresh, "");
})();
