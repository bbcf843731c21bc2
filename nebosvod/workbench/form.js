// The form of a mission: made from its JSON Schema and what its text says; each change is told as a path and a value.
"use strict";

const NUMBER = /^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?$/;

class Form {
  // change(path, value, written) is called for each change; value null takes the key away
  constructor(root, change) {
    this.root = root;
    this.change = change;
    this.opened = new Map();  // path of a block -> whether it is open
    this.count = 0;
  }

  show(schema, tree) {
    const focus = this.focused(), top = this.root.scrollTop;
    this.definitions = schema.$defs;
    this.count = 0;
    const made = document.createDocumentFragment();
    this.fields(made, schema, tree && typeof tree === "object" && !Array.isArray(tree) ? tree : {}, []);
    this.root.replaceChildren(made);
    this.root.scrollTop = top;
    if (focus) this.focus(focus);
  }

  // where the keyboard is, so that it stays there when the form is made anew
  focused() {
    const at = document.activeElement;
    if (!at || !this.root.contains(at) || !at.dataset.path) return null;
    return {path: at.dataset.path, role: at.dataset.role, from: at.selectionStart, to: at.selectionEnd, typed: at.value, known: at.dataset.known};
  }

  focus(was) {
    const found = [...this.root.querySelectorAll("[data-path]")].find(e => e.dataset.path === was.path && e.dataset.role === was.role);
    if (!found) return;
    found.focus({preventScroll: true});
    if (was.from !== null && was.from !== undefined && found.setSelectionRange) {
      if (was.typed !== was.known && found.dataset.known === was.known) found.value = was.typed;  // typed meanwhile
      found.setSelectionRange(was.from, was.to);
    }
  }

  // problems by the path they are told at
  complain(problems) {
    for (const e of this.root.querySelectorAll("[aria-invalid]")) {
      e.removeAttribute("aria-invalid");
      if (e.dataset.why) e.setAttribute("aria-describedby", e.dataset.why); else e.removeAttribute("aria-describedby");
    }
    for (const e of this.root.querySelectorAll(".wrong")) e.remove();
    for (const {text} of problems) {
      const said = text.match(/^([\w.[\]-]+): (.*)$/s);
      if (!said) continue;
      const path = JSON.stringify(said[1].split(/[.[\]]+/).filter(Boolean).map(s => /^\d+$/.test(s) ? Number(s) : s));
      const at = [...this.root.querySelectorAll("[data-path]")].find(e => e.dataset.path === path);
      if (!at) continue;
      at.setAttribute("aria-invalid", "true");
      const words = element("p", {className: "wrong", id: `wrong-${this.count++}`, textContent: said[2]});
      (at.closest(".row") || at.parentNode).append(words);
      at.setAttribute("aria-describedby", words.id);
    }
  }

  resolve(schema) {
    while (schema && schema.$ref) {
      const {$ref, ...own} = schema;
      schema = {...this.definitions[$ref.slice("#/$defs/".length)], ...own};
    }
    return schema || {};
  }

  // what a value may be: resolved schemas without null, of a block that says its kind each kind by its word
  variants(schema, value) {
    let s = this.resolve(schema);
    if (s.if) {
      const like = value && typeof value === "object" && s.if.required.every(key => value[key] != null);
      s = this.resolve(like ? s.then : s.else);
    }
    const any = s.anyOf || s.oneOf;
    if (!any) return {all: [s], schema: s};
    const all = any.flatMap(one => this.variants(one, value).all).filter(one => one.type !== "null");
    return {all, schema: s, key: s.discriminator && s.discriminator.propertyName};
  }

  chosen(all, value) {
    const fits = one => {
      if (Array.isArray(value)) return one.type === "array" ? 2 : -1;
      if (value && typeof value === "object") {
        if (!one.properties) return -1;
        const keys = Object.keys(value);
        let n = keys.filter(key => key in one.properties).length + 1;
        for (const key of keys) {
          const own = this.resolve(one.properties[key] || {}), words = own.const !== undefined ? [own.const] : own.enum;
          if (words) n += words.includes(value[key]) ? 100 : -100;
        }
        return n;
      }
      if (one.properties || one.type === "array") return -1;
      if (one.const !== undefined) return one.const === value ? 3 : 0;
      if (one.enum) return one.enum.includes(value) ? 3 : 0;
      if (typeof value === "number") return one.type === "number" || one.type === "integer" ? 2 : 1;
      if (typeof value === "boolean") return one.type === "boolean" ? 2 : 1;
      return one.type === "string" ? 2 : 1;
    };
    return all.map(one => [fits(one), one]).reduce((best, one) => one[0] > best[0] ? one : best, [-Infinity, all[0]])[1];
  }

  // the least that such a value must say
  skeleton(schema, old) {
    const {all} = this.variants(schema, {}), s = all[0];
    if (s.const !== undefined) return s.const;
    if (s.enum) return s.enum[0];
    if (s.properties) {
      const keys = s.required && s.required.length ? s.required : Object.keys(s.properties).slice(0, 1);
      return Object.fromEntries(keys.map(key => [key, old && old[key] !== undefined ? old[key] : this.skeleton(s.properties[key])]));
    }
    if (s.type === "array") return Array.from({length: Math.max(1, s.minItems || 0)}, () => s.items ? this.skeleton(s.items) : 0);
    if (s.examples) return s.examples[0];
    if (s.type === "number" || s.type === "integer") return s.minimum !== undefined ? s.minimum : s.exclusiveMinimum !== undefined ? s.exclusiveMinimum + 1 : 0;
    if (s.type === "boolean") return true;
    return s.default != null ? s.default : "name";
  }

  fields(into, schema, value, path) {
    const required = new Set(schema.required || []), properties = schema.properties || {};
    const here = Object.keys(properties).filter(key => key in value || required.has(key));
    for (const key of here) into.append(this.field(properties[key], value[key], [...path, key], key, required.has(key)));
    for (const key of Object.keys(value)) if (!(key in properties)) into.append(this.unknown(value[key], [...path, key], key));
    const absent = Object.keys(properties).filter(key => !here.includes(key));
    if (absent.length) into.append(this.adder(absent, properties, path));
  }

  adder(absent, properties, path) {
    const select = element("select", {ariaLabel: `Add to ${path.join(" ") || "the mission"}`});
    this.tag(select, path, "add");
    select.append(element("option", {value: "", textContent: "add…"}));
    for (const key of absent) {
      const about = this.resolve(properties[key]).description;
      select.append(element("option", {value: key, textContent: about ? `${key}: ${about.slice(0, 60)}` : key}));
    }
    const add = element("button", {type: "button", textContent: "Add"});
    add.addEventListener("click", () => {
      if (!select.value) { select.focus(); return; }
      const s = this.resolve(properties[select.value]);
      const plain = s.default != null && typeof s.default !== "object";
      const key = [...path, select.value];
      this.opened.set(JSON.stringify(key), true);
      this.change(key, plain && s.type !== "string" ? s.default : this.skeleton(properties[select.value]), false);
    });
    const row = element("div", {className: "more"});
    row.append(select, add);
    return row;
  }

  field(schema, value, path, key, required) {
    const {all, schema: whole, key: tag} = this.variants(schema, value);
    const own = this.chosen(all, value === undefined ? null : value), about = this.resolve(schema).description || whole.description || own.description;
    if (value && typeof value === "object") {
      if (Array.isArray(value)) return this.list(own, value, path, key, required, about);
      return this.block(own, value, path, key, required, about, all, tag);
    }
    return this.scalar(all, own, value, path, key, required, about);
  }

  block(schema, value, path, key, required, about, all, tag) {
    const box = this.details(path, key, this.brief(value), path.length < 2);
    if (about) box.append(element("p", {className: "soft", textContent: about}));
    if (!required) box.append(this.less(path, `Take ${key} away`));
    if (all.length > 1 && !tag) box.append(this.shape(all, schema, value, path, key));
    const body = {...schema};
    if (tag) {  // the kind: another has other keys
      body.properties = Object.fromEntries(Object.entries(schema.properties || {}).filter(([name]) => name !== tag));
      box.append(this.kind(all, value, path, tag));
    }
    const rest = tag ? Object.fromEntries(Object.entries(value).filter(([name]) => name !== tag)) : value;
    this.fields(box, {...body, required: (schema.required || []).filter(name => name !== tag)}, rest, path);
    return box;
  }

  // the words that a kind may be, each with its schema
  kinds(all, tag) {
    return all.flatMap(one => {
      const said = this.resolve((one.properties || {})[tag] || {});
      return (said.const !== undefined ? [said.const] : said.enum || []).map(word => [word, one]);
    });
  }

  kind(all, value, path, tag) {
    const words = this.kinds(all, tag), select = element("select", {});
    for (const [word] of words) select.append(element("option", {value: word, textContent: word, selected: word === value[tag]}));
    if (!words.some(([word]) => word === value[tag])) select.prepend(element("option", {value: "", textContent: String(value[tag] ?? ""), selected: true}));
    this.tag(select, [...path, tag]);
    select.addEventListener("change", () => {
      const schema = words.find(([word]) => word === select.value)[1], same = this.chosen(all, value) === schema;
      this.change(path, same ? {...value, [tag]: select.value} : {...this.skeleton(schema, value), [tag]: select.value}, false);
    });
    return this.row(tag, select);
  }

  // another shape of the same thing: a number, or a block with its sigma
  shape(all, own, value, path, key) {
    const select = element("select", {ariaLabel: `How ${key} is said`});
    this.tag(select, path, "shape");
    all.forEach((one, i) => select.append(element("option", {value: String(i), textContent: shapeWord(one), selected: one === own})));
    select.addEventListener("change", () => {
      const next = all[Number(select.value)], was = value && typeof value === "object" && !Array.isArray(value) ? value.value : value;
      if (next.properties) {
        this.opened.set(JSON.stringify(path), true);
        const made = this.skeleton(next, value && typeof value === "object" ? value : "value" in next.properties ? {value: was} : null);
        this.change(path, "value" in next.properties && was != null ? {value: was, ...made, ...{value: was}} : made, false);
      } else this.change(path, was != null && !next.enum && next.const === undefined && next.type !== "array" ? was : this.skeleton(next), false);
    });
    return this.row("said as", select);
  }

  list(schema, value, path, key, required, about) {
    const box = this.details(path, key, counted(value), path.length < 2);
    if (about) box.append(element("p", {className: "soft", textContent: about}));
    if (!required) box.append(this.less(path, `Take ${key} away`));
    value.forEach((one, i) => {
      const at = [...path, i], name = one && typeof one === "object" && one.name ? String(one.name) : `${key} ${i + 1}`;
      if (Array.isArray(one)) box.append(this.unknown(one, at, name));
      else box.append(this.field(schema.items || {}, one, at, name, false));
    });
    const add = element("button", {type: "button", textContent: `Add to ${key}`});
    this.tag(add, path, "more");
    add.addEventListener("click", () => {
      const last = value[value.length - 1], made = last === undefined ? this.skeleton(schema.items || {}) : structuredClone(last);
      if (made && typeof made === "object" && typeof made.name === "string") made.name = fresh(made.name, value.map(one => one && one.name));
      this.opened.set(JSON.stringify([...path, value.length]), true);
      this.change([...path, value.length], made, false);
    });
    const row = element("div", {className: "more"});
    row.append(add);
    box.append(row);
    return box;
  }

  scalar(all, own, value, path, key, required, about) {
    const words = all.flatMap(one => one.const !== undefined ? [one.const] : one.enum || (one.type === "boolean" ? [true, false] : []));
    const free = all.filter(one => one.const === undefined && !one.enum && one.type !== "boolean" && !one.properties && one.type !== "array");
    const shaped = all.filter(one => one.properties || one.type === "array");
    let control;
    if (words.length && !free.length && (value == null || words.includes(value))) {
      control = element("select", {});
      if (value == null) control.append(element("option", {value: "", textContent: ""}));
      for (const word of words) control.append(element("option", {value: String(word), textContent: String(word), selected: word === value}));
      control.addEventListener("change", () => this.change(path, words.find(word => String(word) === control.value), false));
    } else {
      const numeric = free.some(one => one.type === "number" || one.type === "integer");
      const text = free.some(one => one.type === "string");
      control = element("input", {type: "text", value: value == null ? "" : String(value), autocomplete: "off", spellcheck: false});
      const example = own.examples && own.examples[0];
      if (example) control.placeholder = `as ${example}`;
      control.addEventListener("change", () => {
        const typed = control.value.trim();
        if (typed === "") this.change(path, required ? "" : null, false);
        else if (words.map(String).includes(typed)) this.change(path, words.find(word => String(word) === typed), false);
        else this.change(path, typed, NUMBER.test(typed) && (numeric || !text));
      });
    }
    this.tag(control, path);
    control.dataset.known = control.value;
    if (required) control.required = true;
    const row = this.row(key, control, about);
    if (!required) row.querySelector("label").after(control, this.less(path, `Take ${key} away`));
    if (!shaped.length || value == null && !free.length && !words.length) return row;
    const both = document.createDocumentFragment();
    both.append(row, this.shape(all, own, value, path, key));
    return both;
  }

  unknown(value, path, key) {
    const shown = element("input", {type: "text", readOnly: true, value: JSON.stringify(value)});
    this.tag(shown, path);
    const row = this.row(key, shown, "to be changed in the text");
    row.append(this.less(path, `Take ${key} away`));
    return row;
  }

  row(key, control, about) {
    const row = element("div", {className: "row"});
    control.id = control.id || `field-${this.count++}`;
    row.append(element("label", {textContent: key, htmlFor: control.id}), control);
    if (about && about !== "One line of text") {
      const why = element("p", {className: "why", id: `why-${this.count++}`, textContent: about});
      control.dataset.why = why.id;
      control.setAttribute("aria-describedby", why.id);
      row.append(why);
    }
    return row;
  }

  less(path, words) {
    const button = element("button", {type: "button", className: "less", textContent: "×", title: words, ariaLabel: words});
    this.tag(button, path, "less");
    button.addEventListener("click", () => this.change(path, null, false));
    return button;
  }

  details(path, key, brief, open) {
    const name = JSON.stringify(path), box = element("details", {open: this.opened.has(name) ? this.opened.get(name) : open});
    const summary = element("summary", {textContent: key});
    this.tag(summary, path, "summary");
    if (brief) summary.append(element("span", {className: "soft", textContent: brief}));
    box.append(summary);
    box.addEventListener("toggle", () => this.opened.set(name, box.open));
    return box;
  }

  brief(value) {
    const plain = Object.entries(value).filter(([, one]) => one !== null && typeof one !== "object").slice(0, 3);
    return plain.map(([key, one]) => ["name", "kind", "plane", "value", "method"].includes(key) ? one : `${key} ${one}`).join(", ").slice(0, 90);
  }

  tag(control, path, role = "value") {
    control.dataset.path = JSON.stringify(path);
    control.dataset.role = role;
  }
}

function element(name, properties) {
  const {ariaLabel, ...own} = properties, made = Object.assign(document.createElement(name), own);
  if (ariaLabel) made.setAttribute("aria-label", ariaLabel);
  return made;
}

function shapeWord(schema) {
  if (schema.properties) return "a block of keys";
  if (schema.type === "array") return "a list";
  if (schema.const !== undefined) return String(schema.const);
  if (schema.enum) return schema.enum.join(", ");
  return schema.type === "string" ? "a value with its unit" : "a number";
}

function counted(value) {
  const names = value.map(one => one && typeof one === "object" ? one.name : one).filter(one => one != null && typeof one !== "object");
  return names.length ? names.join(", ").slice(0, 90) : `${value.length}`;
}

function fresh(name, taken) {
  const stem = name.replace(/[-_ ]?\d+$/, "");
  for (let n = 2; ; n++) if (!taken.includes(`${stem}-${n}`)) return `${stem}-${n}`;
}
