// Controls for an engine and its settings, made from the worker's menu.

import { element } from "./socket.js";

const KINDS = ["shader", "sampler", "accelerator"];
const CHOICES = {
  shader: "what is computed along a camera ray (an integrator)",
  sampler: "how the random numbers of a sample are made",
  accelerator: "structure that finds intersections of rays",
};

function labelled(text, control, title) {
  if (title) control.setAttribute("aria-description", title);
  return element("label", title ? { title } : {}, `${text} `, control);
}

function select(names, chosen) {
  return element("select", {}, ...names.map((name) => new Option(name, name, false, name === chosen)));
}

// An input for one option of a choice; `read` returns its value.
function optionControl(option, value) {
  if (option.kind === "choice") {
    const made = select(option.values.map(String), String(value));
    made.read = () => option.values.find((known) => String(known) === made.value);
    return made;
  }
  if (option.kind === "json") {
    const made = element("input", { value: JSON.stringify(value) });
    made.read = () => JSON.parse(made.value);
    return made;
  }
  const range = { min: option.low, max: option.high, step: option.kind === "integer" ? 1 : "any" };
  const made = element("input", { type: "number", ...range, value });
  made.read = () => (made.value === "" ? option.default : Number(made.value));
  return made;
}

const FIRST = { shader: { name: "path_tracer", max_depth: 6 }, sampler: { name: "sobol" }, accelerator: { name: "auto" } };

export class SettingsForm {
  // `wanted` are the names that the user chose, which an engine may lack; `remembered` are the options of every choice so far.
  constructor(place, menu, legend, engine = menu.preferred, given = {}) {
    Object.assign(this, { menu, place, legend });
    this.reset(engine, given);
  }

  reset(engine, given = {}) {
    this.wanted = {};
    this.remembered = { shader: {}, sampler: {}, accelerator: {} };
    for (const kind of KINDS) this.choose(kind, FIRST[kind]);
    for (const kind of KINDS) if (given[kind]) this.choose(kind, given[kind]);
    this.build(engine, given);
  }

  choose(kind, { name, ...options }) {
    this.wanted[kind] = name;
    this.remembered[kind][name] = options;
  }

  engineFields() {
    return this.menu.engines.find((known) => known.name === this.engine.value);
  }

  tables() {
    const engine = this.engineFields();
    return {
      shader: this.menu.shaders, accelerator: engine.accelerators,
      sampler: [...this.menu.samplers, ...engine.samplers.filter((own) => !this.menu.samplers.some((known) => known.name === own.name))],
    };
  }

  build(engineName, given = {}) {
    this.engine = select(this.menu.engines.map((engine) => engine.name), engineName);
    this.engine.name = "engine";
    for (const option of this.engine.options) {
      const engine = this.menu.engines.find((known) => known.name === option.value);
      if (engine.problem) { option.disabled = true; option.title = engine.problem; option.textContent += " (not available)"; }
    }
    this.engine.addEventListener("change", () => this.offer());
    this.choices = element("div");
    const cores = this.menu.cores;
    this.threads = element("input", { name: "threads", type: "number", min: 1, max: cores, value: given.threads ?? cores });
    this.precision = select(["engine's own", "float32", "float64"], given.precision);
    this.precision.name = "precision";
    const pair = element(
      "div", { className: "pair" },
      labelled("Threads", this.threads, `threads that render: an integer in [1, ${cores}]`),
      labelled("Precision", this.precision, "precision of the computation; an engine may have one only"),
    );
    this.notice = element("p", { className: "notice", role: "status" });
    const legend = element("legend", {}, this.legend);
    this.more = element("details", { className: "folded", open: true }, element("summary", {}, "Shader, sampler, accelerator, threads"), this.choices, pair);
    this.place.replaceChildren(element("fieldset", {}, legend, labelled("Engine", this.engine), this.notice, this.more));
    this.offer();
  }

  // Offers the shaders, samplers and accelerators of the engine. A wanted one that it lacks is replaced, which the notice
  // says; it is chosen again with an engine that has it.
  offer() {
    const tables = this.tables();
    const { name: engine, refusals } = this.engineFields();
    const before = this.controls ?? {};
    const forced = [];
    this.controls = {};
    this.choices.replaceChildren();
    for (const kind of KINDS) {
      const names = tables[kind].map((choice) => choice.name);
      const refused = refusals[kind] ?? {};
      const able = names.filter((name) => !refused[name]);
      const wanted = this.wanted[kind];
      const chosen = able.includes(wanted) ? wanted : able[0] ?? names[0];
      if (chosen !== wanted) forced.push(`${engine} has no ${kind} ${wanted}: ${chosen} is used.`);
      else if (before[kind] && before[kind].control.value !== wanted) forced.push(`${engine} has the ${kind} ${wanted}: it is used again.`);
      const control = select(names, chosen);
      for (const option of control.options) Object.assign(option, { disabled: option.value in refused, title: refused[option.value] ?? "" });
      control.name = kind;
      const options = element("div", { className: "options" });
      control.addEventListener("change", () => {
        this.wanted[kind] = control.value;
        this.notice.textContent = "";
        this.offerOptions(kind, control.value, options);
      });
      this.choices.append(labelled(kind[0].toUpperCase() + kind.slice(1), control, CHOICES[kind]), options);
      this.controls[kind] = { control, options: {} };
      this.offerOptions(kind, chosen, options);
    }
    this.notice.textContent = forced.join(" ");
  }

  announce(text) {
    this.notice.textContent = [text, this.notice.textContent].filter(Boolean).join(" ");
  }

  offerOptions(kind, name, place) {
    const choice = this.tables()[kind].find((known) => known.name === name);
    const given = this.remembered[kind][name] ?? {};
    const made = {};
    place.replaceChildren(...choice.options.map((option) => {
      const input = optionControl(option, option.key in given ? given[option.key] : option.default);
      input.name = `${kind}.${option.key}`;
      input.addEventListener("change", () => this.remember(kind, name, option, input));
      made[option.key] = input;
      const standard = option.default === null ? "none" : String(option.default);
      const accepts = option.kind === "choice" ? `one of ${option.values.join(", ")}` : option.accepts;
      return labelled(option.key, input, `${option.description} (${accepts}; default: ${standard})`);
    }));
    place.hidden = choice.options.length === 0;
    this.controls[kind].options = made;
  }

  remember(kind, name, option, input) {
    try {
      (this.remembered[kind][name] ??= {})[option.key] = input.read();
    } catch {
      // not a value: `value` throws where it is needed
    }
  }

  // The settings for a request. Throws where an option cannot be read.
  value() {
    const settings = { engine: this.engine.value, threads: Number(this.threads.value) || 1 };
    settings.precision = this.precision.selectedIndex > 0 ? this.precision.value : null;
    for (const kind of KINDS) {
      const { control, options } = this.controls[kind];
      settings[kind] = { name: control.value };
      for (const [key, input] of Object.entries(options)) {
        try {
          settings[kind][key] = input.read();
        } catch {
          throw new Error(`${kind}.${key}: ${input.value} cannot be read`);
        }
      }
    }
    return settings;
  }
}
