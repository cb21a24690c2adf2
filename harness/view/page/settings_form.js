// Controls for an engine and its settings, made from the worker's menu.

const KINDS = ["shader", "sampler", "accelerator"];

function labelled(text, control, title) {
  const label = document.createElement("label");
  label.append(`${text} `, control);
  if (title) label.title = title;
  return label;
}

function select(names, chosen) {
  const made = document.createElement("select");
  for (const name of names) made.append(new Option(name, name, false, name === chosen));
  return made;
}

// An input for one option of a choice; `read` returns its value.
function optionControl(option, value) {
  if (option.kind === "choice") {
    const made = select(option.values.map(String), String(value));
    made.read = () => option.values.find((known) => String(known) === made.value);
    return made;
  }
  const made = document.createElement("input");
  if (option.kind === "json") {
    made.value = JSON.stringify(value);
    made.read = () => JSON.parse(made.value);
    return made;
  }
  Object.assign(made, { type: "number", min: option.low, max: option.high, value, step: option.kind === "integer" ? 1 : "any" });
  made.read = () => (made.value === "" ? option.default : Number(made.value));
  return made;
}

export class SettingsForm {
  constructor(place, menu, legend, engine = menu.preferred) {
    this.menu = menu;
    this.place = place;
    this.legend = legend;
    this.selected = { shader: { name: "path_tracer", max_depth: 6 }, sampler: { name: "sobol" }, accelerator: { name: "auto" } };
    this.build(engine);
  }

  tables() {
    const engine = this.menu.engines.find((known) => known.name === this.engine.value);
    return {
      shader: this.menu.shaders, accelerator: engine.accelerators,
      sampler: [...this.menu.samplers, ...engine.samplers.filter((own) => !this.menu.samplers.some((known) => known.name === own.name))],
    };
  }

  build(engineName) {
    const fieldset = document.createElement("fieldset");
    const legend = document.createElement("legend");
    legend.textContent = this.legend;
    this.engine = select(this.menu.engines.map((engine) => engine.name), engineName);
    this.engine.name = "engine";
    for (const option of this.engine.options) {
      const engine = this.menu.engines.find((known) => known.name === option.value);
      if (engine.problem) { option.disabled = true; option.title = engine.problem; option.textContent += " (not available)"; }
    }
    this.engine.addEventListener("change", () => this.offer());
    this.choices = document.createElement("div");
    this.threads = document.createElement("input");
    Object.assign(this.threads, { name: "threads", type: "number", min: 1, max: this.menu.cores, value: this.menu.cores });
    this.precision = select(["engine's own", "float32", "float64"]);
    this.precision.name = "precision";
    const pair = document.createElement("div");
    pair.className = "pair";
    pair.append(labelled("Threads", this.threads), labelled("Precision", this.precision));
    fieldset.append(legend, labelled("Engine", this.engine), this.choices, pair);
    this.place.replaceChildren(fieldset);
    this.offer();
  }

  // Offers the shaders, samplers and accelerators of the engine; keeps earlier choices that still exist.
  offer() {
    const tables = this.tables();
    const refusals = this.menu.engines.find((known) => known.name === this.engine.value).refusals;
    this.controls = {};
    this.choices.replaceChildren();
    for (const kind of KINDS) {
      const names = tables[kind].map((choice) => choice.name);
      const refused = refusals[kind] ?? {};
      const able = names.filter((name) => !refused[name]);
      const chosen = able.includes(this.selected[kind].name) ? this.selected[kind].name : able[0] ?? names[0];
      const control = select(names, chosen);
      for (const option of control.options) Object.assign(option, { disabled: option.value in refused, title: refused[option.value] ?? "" });
      control.name = kind;
      const options = document.createElement("div");
      options.className = "options";
      control.addEventListener("change", () => this.offerOptions(kind, control.value, options, {}));
      this.choices.append(labelled(kind[0].toUpperCase() + kind.slice(1), control), options);
      this.controls[kind] = { control, options: {} };
      this.offerOptions(kind, chosen, options, this.selected[kind]);
    }
  }

  offerOptions(kind, name, place, given) {
    const choice = this.tables()[kind].find((known) => known.name === name);
    const made = {};
    place.replaceChildren(...choice.options.map((option) => {
      made[option.key] = optionControl(option, given[option.key] ?? option.default);
      made[option.key].name = `${kind}.${option.key}`;
      return labelled(option.key, made[option.key], `${option.description}: ${option.accepts}`);
    }));
    place.hidden = choice.options.length === 0;
    this.controls[kind].options = made;
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
      this.selected[kind] = settings[kind];
    }
    return settings;
  }
}
