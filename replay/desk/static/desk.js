"use strict";
const $ = id => document.getElementById(id);
const zone = $("zone"), live = $("live"), form = $("form");
let typed = false;

function refuse(line) {
  $("refused").append(Object.assign(document.createElement("li"), { textContent: line.trim() }));
}

function put(page, file) {  // XMLHttpRequest: fetch does not tell how much of an upload has gone
  if (file.size > Number(zone.dataset.most)) {
    refuse(`${file.name}: is larger than what is taken here`);
    return Promise.resolve(false);
  }
  return new Promise(done => {
    const request = new XMLHttpRequest();
    request.open("PUT", `${page}/logs/${encodeURIComponent(file.name)}?changed_s=${Math.round(file.lastModified / 1000)}`);
    request.upload.onprogress = e => {
      $("sending").textContent = `copies ${file.name}: ${Math.round(100 * e.loaded / (e.total || 1))} %; leave this page open`;
    };
    request.onload = () => {
      if (request.status !== 201) refuse(request.responseText);
      done(request.status === 201);
    };
    request.onerror = () => { refuse(`${file.name}: the copy broke off; is replay serve still running?`); done(false); };
    request.send(file);
  });
}

function ask(page, kind) {
  const questions = Object.assign(document.createElement("form"), { method: "post", action: `${page}/asks` });
  questions.append(Object.assign(document.createElement("input"), { type: "hidden", name: "kind", value: kind }));
  document.body.append(questions);
  questions.submit();
}

const isLog = file => $("files").accept.split(",").some(suffix => file.name.toLowerCase().endsWith(suffix));

async function inside(entry) {  // every log of a folder, and of the folders in it
  if (entry.isFile) return [await new Promise((done, failed) => entry.file(done, failed))].filter(isLog);
  const reader = entry.createReader(), found = [];
  for (;;) {  // some at a time
    const some = await new Promise((done, failed) => reader.readEntries(done, failed));
    if (!some.length) return found;
    for (const one of some) found.push(...await inside(one));
  }
}

async function dropped(data) {
  const entries = [...data.items].map(item => item.webkitGetAsEntry());
  const files = [...data.files];
  if (!entries.some(entry => entry?.isDirectory)) { take(files); return; }
  const found = [];
  for (const entry of entries) found.push(...await inside(entry));
  take(found, "season");
}

async function take(files, kind) {
  $("refused").replaceChildren();
  if (!files.length) { refuse("there is no log in it"); return; }
  const known = zone.dataset.page;
  const page = known || (await (await fetch("/drops", { method: "POST" })).json()).page;
  let kept = 0;
  for (const file of files) kept += await put(page, file);
  $("sending").textContent = "";
  if (!kept) {
    if (!known) await fetch(`${page}/delete`, { method: "POST" });
    return;
  }
  const go = () => known ? location.reload() : ask(page, kind ?? (kept > 1 ? "season" : "missing"));
  if (!$("refused").childElementCount) { go(); return; }
  const button = Object.assign(document.createElement("button"), { textContent: `Go on with ${kept} of ${files.length}`, onclick: go });
  $("sending").append(button);
}

zone.addEventListener("dragover", e => { e.preventDefault(); zone.className = "over"; });
zone.addEventListener("dragleave", () => { zone.className = ""; });
zone.addEventListener("drop", e => { e.preventDefault(); zone.className = ""; dropped(e.dataTransfer); });
$("files").addEventListener("change", e => take([...e.target.files]));
$("folder").addEventListener("change", e => take([...e.target.files].filter(isLog), "season"));

const answer = $("answer");
if (answer) {  // as high as what is in it, so that the page scrolls and not a part of it
  window.addEventListener("message", e => {
    const height = Number(e.data?.height_px);
    if (e.source === answer.contentWindow && height > 0) answer.style.height = `${height + 8}px`;
  });
}

async function look() {
  let wait = 1000;
  try {
    const now = new DOMParser().parseFromString(await (await fetch(location.href)).text(), "text/html");
    const steps = [...now.querySelectorAll(".doing")];
    for (const [k, e] of document.querySelectorAll(".doing").entries()) e.textContent = steps[k]?.textContent ?? "done";
    if (now.getElementById("live")?.dataset.version !== live.dataset.version) {
      if (!typed) { location.reload(); return; }
      live.innerHTML = '<p><a href="">There is something new: show it.</a> What you typed and did not ask will be gone.</p>';
    }
    if (!document.querySelector(".doing")) wait = 5000;
  } catch { wait = 5000; }
  setTimeout(look, wait);
}
if (live) {
  setTimeout(look, 700);
  form.addEventListener("input", () => { typed = true; });
}
const trial = $("trial");
if (trial) trial.addEventListener("submit", () => {
  trial.querySelector("button").disabled = true;
  $("sending").textContent = "flies; the question is asked then";
});
