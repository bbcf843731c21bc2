// The page of one mission: its text and its form side by side, and what it would give, looked at anew after each change.
"use strict";

const WAIT = 200;  // ms after the last letter
const $ = id => document.getElementById(id);
const text = $("text");
const state = {mark: "", kept: "", saved: true, schemas: null, tree: undefined, fit: false, slug: "", valid: false, running: false};
let timer = 0, looking = null, editing = Promise.resolve();

async function post(where, what, signal) {
  return fetch(where, {method: "POST", headers: {"content-type": "application/json"}, body: JSON.stringify(what), signal});
}

async function* lines(response) {
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const {value, done} = await reader.read();
    if (done) return;
    const parts = (rest + value).split("\n");
    rest = parts.pop();
    for (const part of parts) if (part) yield JSON.parse(part);
  }
}

async function refusal(response) {
  try { return (await response.json()).text; } catch { return `the server answered ${response.status}`; }
}

function lost(error) {
  state.valid = false;
  verdict(`The server does not answer (${error.message}). The text is still here: copy it, start nebosvod open again.`, true);
  buttons();
}

// ---- looking

function changed() {
  numbers();
  buttons();
  if (looking) looking.abort();  // the answer of a text that is no more is none
  clearTimeout(timer);
  timer = setTimeout(look, WAIT);
}

async function look() {
  if (looking) looking.abort();
  const mine = looking = new AbortController();
  $("speed").textContent = "computing";
  try {
    const response = await post("look", {text: text.value}, mine.signal);
    if (!response.ok) wrong([{line: null, text: await refusal(response)}], []);
    else for await (const message of lines(response)) {
      if (mine !== looking) return;
      take(message);
    }
    $("speed").dataset.looks = Number($("speed").dataset.looks || 0) + 1;  // that came to their end
  } catch (error) {
    if (error.name !== "AbortError") lost(error);
  }
}

function take(message) {
  if (message.step === "checked") {
    Object.assign(state, {fit: message.fit, slug: message.slug, valid: !message.problems.length});
    $("cost").textContent = message.cost ? `A run: ${message.cost}` : "";
    if (message.tree !== null) show(message.tree);
    $("form").classList.toggle("stale", message.tree === null);
    wrong(message.problems, message.notices);
    if (message.problems.length) stale("of the text before: this one cannot be read yet");
  } else if (message.step === "found") {
    $(message.part).innerHTML = message.html;
    if (message.part === "answer") for (const part of ["answer", "target", "visibility"]) $(part).classList.remove("stale");
    if (message.part === "answer" && state.fit) for (const part of ["target", "visibility"]) $(part).replaceChildren();
  } else if (message.step === "failed") {
    wrong(message.problems, [], "Valid, but there is no answer:");
    stale("of the text before: this one has no answer");
  } else if (message.step === "broken") {
    wrong([{line: null, text: message.text}], [], "The computation broke off; please report this:");
    stale("of the text before");
  } else if (message.step === "done") {
    $("speed").textContent = `in ${message.seconds.toFixed(2)} s`;
  }
  buttons();
}

function stale(words) {
  $("speed").textContent = words;
  for (const part of ["answer", "target", "visibility"]) $(part).classList.add("stale");
}

function verdict(words, bad) {
  $("verdict-line").textContent = words;
  $("check").classList.toggle("wrong", bad);
}

function wrong(problems, notices, lead) {
  const count = `${problems.length} ${problems.length === 1 ? "thing is" : "things are"} wrong:`;
  verdict(problems.length ? lead || count : "Valid.", problems.length > 0);
  const rows = problems.map(one => {
    const row = element("li", {}), button = element("button", {type: "button"});
    button.textContent = one.line === null ? one.text : `line ${one.line}, column ${one.column}: ${one.text}`;
    if (one.line !== null) button.addEventListener("click", () => caret(one.line, one.column));
    row.append(button);
    return row;
  });
  rows.push(...notices.map(words => element("li", {className: "notice", textContent: `notice: ${words}`})));
  $("problems").replaceChildren(...rows);
  waves(problems);
  form.complain(problems);
}

// ---- the text

function offset(line, column) {
  let at = 0;
  for (let n = 1; n < line; n++) {
    const next = text.value.indexOf("\n", at);
    if (next < 0) break;
    at = next + 1;
  }
  return Math.min(at + column - 1, text.value.length);
}

function word(at) {  // the end of the word or value that begins there
  const rest = text.value.slice(at).match(/^[^\s,{}[\]#]*/)[0];
  return at + Math.max(1, rest.length);
}

function caret(line, column) {
  const at = offset(line, column);
  text.focus();
  text.setSelectionRange(at, word(at));
  const height = parseFloat(getComputedStyle(text).lineHeight);
  text.scrollTop = Math.max(0, (line - 4) * height);
}

function waves(problems) {
  const style = getComputedStyle(text), height = parseFloat(style.lineHeight), pad = parseFloat(style.paddingTop);
  const paper = document.createElement("canvas").getContext("2d");
  paper.font = style.font;
  const wide = paper.measureText("0".repeat(100)).width / 100;
  $("waves").replaceChildren(...problems.filter(one => one.line !== null).slice(0, 50).map(one => {
    const at = offset(one.line, one.column), mark = document.createElement("i");
    mark.dataset.line = one.line;
    mark.dataset.column = one.column;
    mark.style.top = `${pad + (one.line - 1) * height}px`;
    mark.style.left = `${pad + (one.column - 1) * wide}px`;
    mark.style.width = `${Math.max(1, word(at) - at) * wide}px`;
    return mark;
  }));
  scrolled();
}

function scrolled() {
  $("gutter").scrollTop = text.scrollTop;
  for (const mark of $("waves").children) mark.style.transform = `translate(${-text.scrollLeft}px, ${-text.scrollTop}px)`;
}

function numbers() {
  const count = text.value.split("\n").length;
  if (Number($("gutter").dataset.count) === count) return;
  $("gutter").dataset.count = count;
  $("gutter").textContent = Array.from({length: count}, (_, i) => i + 1).join("\n") + "\n\n";
  scrolled();
}

// put other letters where the text differs, so that the caret and what is around it stay
function retext(next) {
  const old = text.value;
  if (next === old) return;
  let from = 0, back = 0;
  while (from < old.length && from < next.length && old[from] === next[from]) from++;
  while (back < old.length - from && back < next.length - from && old[old.length - 1 - back] === next[next.length - 1 - back]) back++;
  text.setRangeText(next.slice(from, next.length - back), from, old.length - back, "preserve");
  changed();
}

text.addEventListener("input", changed);
text.addEventListener("scroll", scrolled);
text.addEventListener("keydown", event => {
  if (event.key !== "Enter" || event.ctrlKey || event.metaKey || event.isComposing) return;
  const line = text.value.slice(0, text.selectionStart).split("\n").pop();
  const indent = line.match(/^ */)[0];
  if (indent && document.execCommand("insertText", false, "\n" + indent)) event.preventDefault();  // with its undo
});

// ---- the form

const form = new Form($("form"), (path, value, written) => {
  editing = editing.then(() => edit(path, value, written)).catch(lost);
});

async function edit(path, value, written) {
  const before = text.value, response = await post("edit", {text: before, path, value, written});
  if (!response.ok) return wrong([{line: null, text: await refusal(response)}], []);
  for await (const message of lines(response)) {
    if (message.step === "edited") {
      if (text.value !== before) return edit(path, value, written);  // somebody typed meanwhile
      retext(message.text);
    } else if (message.step === "refused") {
      wrong(message.problems, []);
    } else wrong([{line: null, text: message.text}], []);
  }
}

function show(tree) {
  const said = JSON.stringify([state.fit, tree]);
  if (said === state.tree) return;
  state.tree = said;
  form.show(state.schemas[state.fit ? "fit" : "mission"], tree);
}

// ---- save and run

function dirty() { return text.value !== state.kept; }

function buttons() {
  $("save").disabled = state.schemas === null;  // also what is as it was read: its file may be gone meanwhile
  $("save").textContent = state.saved ? "Save" : "Save as file";
  $("run").disabled = !state.valid || state.running;
  $("run").textContent = dirty() ? "Save and run" : "Run";
  $("stop").hidden = !state.running;
  $("state").textContent = dirty() ? "(changed, not saved)" : state.saved ? "(saved)" : "(built in)";
  document.title = `${dirty() ? "* " : ""}${$("name").textContent}: nebosvod`;
}

function ask(words, choices) {
  $("asked").textContent = words;
  $("answers").replaceChildren(...choices.map(([value, label]) => element("button", {value, textContent: label})));
  $("ask").returnValue = "";
  $("ask").showModal();
  return new Promise(resolve => $("ask").addEventListener("close", () => resolve($("ask").returnValue), {once: true}));
}

async function save() {
  const sent = text.value, response = await post("save", {text: sent, mark: state.mark});
  const answer = await response.json();
  if (response.ok) {
    Object.assign(state, {mark: answer.mark, kept: sent, saved: true});
    $("place").textContent = answer.path;
    buttons();
    return true;
  }
  if (response.status !== 409) {
    verdict(answer.text, true);
    return false;
  }
  const there = [["over", "Write mine over it"], ["take", "Take the file's text"]];
  const chosen = await ask(answer.text, [["", "Cancel"], ...(answer.mark ? there : [["over", "Write it again"]])]);
  if (chosen === "take") await load();
  if (chosen !== "over") return false;
  state.mark = answer.mark;
  return save();
}

async function run(overwrite) {
  if (dirty() && !await save()) return;
  state.running = true;
  $("ran").hidden = false;
  $("running").textContent = "starting";
  $("said").textContent = "";
  buttons();
  let again = false;
  try {
    const what = {verb: state.fit ? "fit" : "run", slug: state.slug, mark: state.mark, overwrite};
    const response = await post("run", what);
    if (!response.ok) $("running").textContent = await refusal(response);
    else for await (const message of lines(response)) {
      if (message.step === "running") $("running").textContent = `running for ${message.seconds.toFixed(0)} s`;
      else if (message.step === "refused") $("running").textContent = message.text;
      else {
        $("said").textContent = message.text;
        $("report").hidden = !message.report;
        $("running").textContent = ended(message.code);
        again = message.code === 3 && !overwrite && message.text.includes("use --overwrite");
      }
    }
  } catch (error) { lost(error); }
  state.running = false;
  buttons();
  if (again && await ask($("said").textContent.trim().split("\n")[0].replace(/^error: /, "").replace(/; use --overwrite.*/, "."),
    [["", "Cancel"], ["yes", "Replace that run"]])) return run(true);
}

function ended(code) {
  if (code === 0) return "done; see the report";
  if (code === 1) return "finished, but not all of it can be trusted; see below";
  if (code === 130 || code < 0) return "stopped; nothing half-written is left";
  return "not run; see below";
}

async function load() {
  const response = await fetch("start");
  if (!response.ok) {  // the file is gone, or can be read no more; what stands here stays
    verdict(await refusal(response), true);
    return;
  }
  const answer = await response.json();
  Object.assign(state, {mark: answer.mark, saved: answer.saved, schemas: answer.schemas});
  $("name").textContent = answer.name;
  $("place").textContent = answer.saved ? answer.path : `built in; saving writes ${answer.path}`;
  text.value = answer.text;
  state.kept = text.value;  // as the browser keeps it: line breaks are its own
  changed();
}

$("save").addEventListener("click", () => save().catch(lost));
$("run").addEventListener("click", () => run(false));
$("stop").addEventListener("click", () => post("stop", {}).catch(lost));
document.addEventListener("keydown", event => {
  if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
  if (event.key === "s") { event.preventDefault(); if (!$("save").disabled) save().catch(lost); }
  if (event.key === "Enter" && !$("run").disabled) { event.preventDefault(); run(false); }
});
window.addEventListener("beforeunload", event => { if (dirty()) event.preventDefault(); });
load().catch(lost);
