"use strict";
(() => {
  const study = JSON.parse(document.getElementById("study").textContent);
  const store = `pbrnet-pairs-${study.page}`;
  const limit = 1000 * (study.seconds + study.answer_seconds);
  const part = (id) => document.getElementById(id);
  const pictures = { left: part("left-picture"), right: part("right-picture") };

  let run = recall();
  let tried = 0; // practice pairs seen
  // still: nothing under way. gap: the next pair is being got ready. shown: the pictures are seen.
  // hidden: they are gone, an answer is still taken.
  let phase = "still";
  let turn = 0; // grows with everything that ends a pair, so that nothing belated touches the next
  let timers = [];
  let began = 0; // when the pictures appeared
  let restAsked = false;
  let lasting = true; // whether the browser keeps what it is given

  function fresh() {
    const bytes = crypto.getRandomValues(new Uint8Array(16));
    const session = Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
    return { session, practised: study.practice.length === 0, answers: [], underway: null };
  }

  // What this browser has kept of a run of this very page, or a new run.
  function recall() {
    try {
      const kept = JSON.parse(localStorage.getItem(store));
      const fits =
        kept !== null &&
        /^[0-9a-f]{32}$/.test(kept.session) &&
        Array.isArray(kept.answers) &&
        kept.answers.length <= study.pairs.length &&
        kept.answers.every((answer, index) => answer.pair === study.pairs[index].pair);
      return fits ? kept : fresh();
    } catch {
      return fresh();
    }
  }

  function keep() {
    try {
      localStorage.setItem(store, JSON.stringify(run));
      lasting = true;
    } catch {
      lasting = false;
    }
    part("warning").hidden = lasting;
  }

  // The pair that is due; nothing after the last.
  function due() {
    if (!run.practised) {
      const words = `Practice ${tried + 1} of ${study.practice.length}`;
      return { ...study.practice[tried], words, done: tried / study.practice.length, counts: false };
    }
    const index = run.answers.length;
    if (index >= study.pairs.length) return null;
    const words = `Pair ${index + 1} of ${study.pairs.length}`;
    return { ...study.pairs[index], words, done: index / study.pairs.length, counts: true };
  }

  function enter(next) {
    phase = next;
    document.body.dataset.phase = next;
    const open = next === "shown" || next === "hidden";
    part("left").disabled = part("right").disabled = !open;
  }

  function show(section) {
    for (const name of ["intro", "trial", "rest", "done"]) part(name).hidden = name !== section;
  }

  function stop() {
    turn += 1;
    timers.forEach(clearTimeout);
    timers = [];
    for (const picture of Object.values(pictures)) picture.removeAttribute("src");
    part("time").style.width = "0";
    part("time-words").textContent = "\u00a0";
  }

  async function begin() {
    stop();
    const mine = turn;
    const pair = due();
    if (pair === null) return finish();
    enter("gap");
    show("trial");
    document.body.dataset.pair = pair.pair;
    part("count").textContent = pair.words;
    part("progress").value = pair.done;
    const waited = new Promise((ready) => setTimeout(ready, 1000 * study.gap));
    try {
      for (const side of ["left", "right"]) pictures[side].src = pair[side];
      await Promise.all([waited, pictures.left.decode(), pictures.right.decode()]);
    } catch {
      if (mine === turn) rest("The pictures cannot be drawn", "Try again, or open the page in another browser.");
      return;
    }
    if (mine !== turn) return;
    const { naturalWidth, naturalHeight } = pictures.left;
    part("pictures").style.setProperty("--aspect", `${naturalWidth} / ${naturalHeight}`);
    requestAnimationFrame((now) => mine === turn && reveal(pair, now));
  }

  function reveal(pair, now) {
    began = now;
    enter("shown");
    if (pair.counts) {
      run.underway = pair.pair;
      keep();
    }
    timers = [
      setTimeout(() => enter("hidden"), 1000 * study.seconds),
      setTimeout(() => settle(null), limit),
    ];
    tick(turn);
  }

  // The timer bar runs down once for the pictures, and once more for the answer.
  function tick(mine) {
    if (mine !== turn) return;
    const passed = (performance.now() - began) / 1000;
    const seen = phase === "shown";
    const whole = seen ? study.seconds : study.answer_seconds;
    const left = Math.max(0, (seen ? study.seconds : study.seconds + study.answer_seconds) - passed);
    part("time").style.width = `${Math.min(100, (100 * left) / whole)}%`;
    const words = `${left.toFixed(1)} s left to ${seen ? "look" : "answer"}`;
    if (part("time-words").textContent !== words) part("time-words").textContent = words;
    requestAnimationFrame(() => tick(mine));
  }

  // Take the side, or null where none was chosen in time, and go on.
  function settle(side) {
    if (phase !== "shown" && phase !== "hidden") return;
    const pair = due();
    const ms = Math.max(0, Math.round(performance.now() - began));
    stop();
    enter("still");
    if (pair.counts) {
      run.answers.push({ pair: pair.pair, side, ms, timed_out: side === null });
      run.underway = null;
    } else {
      tried += 1;
      run.practised = tried >= study.practice.length;
    }
    keep();
    if (due() === null) finish();
    else if (!pair.counts && run.practised) rest("That was the practice", "From now on your answers count.");
    else if (side === null) rest("No answer in time", "That happens. Go on when you are ready.");
    else if (restAsked) rest("Pause", "Go on when you are ready.");
    else begin();
  }

  function rest(title, words) {
    stop();
    enter("still");
    restAsked = false;
    part("pause").disabled = false;
    const done = run.answers.length;
    const count = run.practised && done ? ` ${done} of ${study.pairs.length} pairs are done.` : "";
    part("rest-title").textContent = title;
    part("rest-words").textContent = words + count;
    part("status").textContent = `${title}. ${words}`;
    show("rest");
    part("go").focus();
  }

  // In the gap at once; while a pair is open, after it.
  function askRest() {
    if (phase === "gap") {
      rest("Pause", "Go on when you are ready.");
    } else if (phase === "shown" || phase === "hidden") {
      restAsked = true;
      part("pause").disabled = true;
      part("status").textContent = "Pausing after this pair.";
    }
  }

  function finish() {
    stop();
    enter("still");
    const { study: kind, version, page, seed } = study;
    const answers = { study: kind, version, page, seed, session: run.session, answers: run.answers };
    const text = JSON.stringify(answers, null, 1) + "\n";
    const late = run.answers.filter((answer) => answer.timed_out).length;
    part("done-words").textContent =
      `You have answered ${run.answers.length - late} of ${run.answers.length} pairs.` +
      (late ? ` In ${late} no answer came in time; they are left out.` : "");
    part("text").value = text;
    const link = part("download");
    if (link.href) URL.revokeObjectURL(link.href);
    link.href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
    link.download = `pairs-${page}-${run.session.slice(0, 8)}.json`;
    show("done");
    link.focus();
  }

  // A pair that was being shown when the page went away has been seen: it is not shown again.
  function closeInterrupted() {
    const pair = due();
    if (run.underway !== null && pair !== null && pair.counts && pair.pair === run.underway) {
      run.answers.push({ pair: pair.pair, side: null, ms: Math.round(limit), timed_out: true });
    }
    run.underway = null;
  }

  document.addEventListener("keydown", (event) => {
    if (phase === "still" || event.ctrlKey || event.altKey || event.metaKey) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const sides = { ArrowLeft: "left", f: "left", ArrowRight: "right", j: "right" };
    if (!(key in sides) && key !== "p") return;
    event.preventDefault();
    if (event.repeat) return;
    if (key === "p") askRest();
    else settle(sides[key]);
  });
  for (const side of ["left", "right"]) {
    for (const name of [side, `${side}-frame`]) {
      part(name).addEventListener("click", () => {
        // Else Space and Enter would choose this side again in the next pair.
        document.activeElement?.blur();
        settle(side);
      });
    }
  }
  part("start").addEventListener("click", begin);
  part("go").addEventListener("click", begin);
  part("pause").addEventListener("click", askRest);
  part("again").addEventListener("click", () => {
    if (!confirm("Remove these answers from this browser? Save them first.")) return;
    run = fresh();
    tried = 0;
    keep();
    part("resume").hidden = true;
    part("start").textContent = "Start";
    show("intro");
  });
  document.addEventListener("visibilitychange", () => {
    if (document.visibilityState !== "hidden") return;
    if (phase === "gap") rest("Pause", "Go on when you are ready.");
    else settle(null);
  });
  addEventListener("beforeunload", (event) => {
    if (!lasting && run.answers.length) event.preventDefault();
  });

  closeInterrupted();
  keep();
  if (due() === null) {
    finish();
  } else if (run.answers.length) {
    part("resume").textContent =
      `You have been here before: ${run.answers.length} of ${study.pairs.length} pairs are done.`;
    part("resume").hidden = false;
    part("start").textContent = "Go on";
  }
})();
