"use strict";
(() => {
  const study = JSON.parse(document.getElementById("study").textContent);
  const store = `pbrnet-pairs-${study.page}`;
  const limit = 1000 * (study.seconds + study.answer_seconds);
  const part = (id) => document.getElementById(id);
  const pictures = { left: part("left-picture"), right: part("right-picture") };

  let run = restoreRun();
  let practiceDone = 0; // answered practice pairs
  // still: no pair. gap: the next pair is being loaded. shown: the pictures are visible.
  // hidden: the pictures have disappeared, an answer is still accepted.
  let phase = "still";
  let turn = 0; // incremented at the end of a pair, so that late callbacks do not affect the next pair
  let timers = [];
  let shownAt = 0; // time at which the pictures appeared, ms
  let pauseRequested = false;
  let storageWorks = true; // whether localStorage works

  function newRun() {
    const bytes = crypto.getRandomValues(new Uint8Array(16));
    const session = Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
    return { session, practised: study.practice.length === 0, answers: [], underway: null };
  }

  // Return the stored run of this page, or a new one.
  function restoreRun() {
    try {
      const kept = JSON.parse(localStorage.getItem(store));
      const fits =
        kept !== null &&
        /^[0-9a-f]{32}$/.test(kept.session) &&
        Array.isArray(kept.answers) &&
        kept.answers.length <= study.pairs.length &&
        kept.answers.every((answer, index) => answer.pair === study.pairs[index].pair);
      return fits ? kept : newRun();
    } catch {
      return newRun();
    }
  }

  function saveRun() {
    try {
      localStorage.setItem(store, JSON.stringify(run));
      storageWorks = true;
    } catch {
      storageWorks = false;
    }
    part("warning").hidden = storageWorks;
  }

  // Return the next pair; null after the last.
  function nextPair() {
    if (!run.practised) {
      const words = `Practice ${practiceDone + 1} of ${study.practice.length}`;
      return { ...study.practice[practiceDone], words, done: practiceDone / study.practice.length, counts: false };
    }
    const index = run.answers.length;
    if (index >= study.pairs.length) return null;
    const words = `Pair ${index + 1} of ${study.pairs.length}`;
    return { ...study.pairs[index], words, done: index / study.pairs.length, counts: true };
  }

  function setPhase(next) {
    phase = next;
    document.body.dataset.phase = next;
    const open = next === "shown" || next === "hidden";
    part("left").disabled = part("right").disabled = !open;
  }

  function showSection(section) {
    for (const name of ["intro", "trial", "rest", "done"]) part(name).hidden = name !== section;
  }

  function stopPair() {
    turn += 1;
    timers.forEach(clearTimeout);
    timers = [];
    for (const picture of Object.values(pictures)) picture.removeAttribute("src");
    part("time").style.width = "0";
    part("time-words").textContent = "\u00a0";
  }

  async function startPair() {
    stopPair();
    const myTurn = turn;
    const pair = nextPair();
    if (pair === null) return finish();
    setPhase("gap");
    showSection("trial");
    document.body.dataset.pair = pair.pair;
    part("count").textContent = pair.words;
    part("progress").value = pair.done;
    const waited = new Promise((ready) => setTimeout(ready, 1000 * study.gap));
    try {
      for (const side of ["left", "right"]) pictures[side].src = pair[side];
      await Promise.all([waited, pictures.left.decode(), pictures.right.decode()]);
    } catch {
      if (myTurn === turn) pause("The pictures cannot be displayed", "Try again, or open the page in another browser.");
      return;
    }
    if (myTurn !== turn) return;
    const { naturalWidth, naturalHeight } = pictures.left;
    part("pictures").style.setProperty("--aspect", `${naturalWidth} / ${naturalHeight}`);
    requestAnimationFrame((now) => myTurn === turn && showPair(pair, now));
  }

  function showPair(pair, now) {
    shownAt = now;
    setPhase("shown");
    if (pair.counts) {
      run.underway = pair.pair;
      saveRun();
    }
    timers = [
      setTimeout(() => setPhase("hidden"), 1000 * study.seconds),
      setTimeout(() => recordAnswer(null), limit),
    ];
    updateTimer(turn);
  }

  // The timer bar runs once for the pictures, and once more for the answer.
  function updateTimer(myTurn) {
    if (myTurn !== turn) return;
    const passed = (performance.now() - shownAt) / 1000;
    const seen = phase === "shown";
    const whole = seen ? study.seconds : study.answer_seconds;
    const left = Math.max(0, (seen ? study.seconds : study.seconds + study.answer_seconds) - passed);
    part("time").style.width = `${Math.min(100, (100 * left) / whole)}%`;
    const words = `${left.toFixed(1)} s left to ${seen ? "look" : "answer"}`;
    if (part("time-words").textContent !== words) part("time-words").textContent = words;
    requestAnimationFrame(() => updateTimer(myTurn));
  }

  // Record a side, or null for none in time, and continue.
  function recordAnswer(side) {
    if (phase !== "shown" && phase !== "hidden") return;
    const pair = nextPair();
    const ms = Math.max(0, Math.round(performance.now() - shownAt));
    stopPair();
    setPhase("still");
    if (pair.counts) {
      run.answers.push({ pair: pair.pair, side, ms, timed_out: side === null });
      run.underway = null;
    } else {
      practiceDone += 1;
      run.practised = practiceDone >= study.practice.length;
    }
    saveRun();
    if (nextPair() === null) finish();
    else if (!pair.counts && run.practised) pause("End of the practice", "From now on, your answers count.");
    else if (side === null) pause("No answer in time", "Continue when you are ready.");
    else if (pauseRequested) pause("Pause", "Continue when you are ready.");
    else startPair();
  }

  function pause(title, words) {
    stopPair();
    setPhase("still");
    pauseRequested = false;
    part("pause").disabled = false;
    const done = run.answers.length;
    const count = run.practised && done ? ` ${done} of ${study.pairs.length} pairs are done.` : "";
    part("rest-title").textContent = title;
    part("rest-words").textContent = words + count;
    part("status").textContent = `${title}. ${words}`;
    showSection("rest");
    part("go").focus();
  }

  // Pause at once in the gap, or after the current pair.
  function requestPause() {
    if (phase === "gap") {
      pause("Pause", "Continue when you are ready.");
    } else if (phase === "shown" || phase === "hidden") {
      pauseRequested = true;
      part("pause").disabled = true;
      part("status").textContent = "Pause after this pair.";
    }
  }

  function finish() {
    stopPair();
    setPhase("still");
    const { study: kind, version, page, seed } = study;
    const answers = { study: kind, version, page, seed, session: run.session, answers: run.answers };
    const text = JSON.stringify(answers, null, 1) + "\n";
    const late = run.answers.filter((answer) => answer.timed_out).length;
    part("done-words").textContent =
      `You have answered ${run.answers.length - late} of ${run.answers.length} pairs.` +
      (late ? ` ${late} timed out and are left out.` : "");
    part("text").value = text;
    const link = part("download");
    if (link.href) URL.revokeObjectURL(link.href);
    link.href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
    link.download = `pairs-${page}-${run.session.slice(0, 8)}.json`;
    showSection("done");
    link.focus();
  }

  // A pair that was visible when the page was closed is not shown again.
  function countInterruptedPair() {
    const pair = nextPair();
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
    if (key === "p") requestPause();
    else recordAnswer(sides[key]);
  });
  for (const side of ["left", "right"]) {
    for (const name of [side, `${side}-frame`]) {
      part(name).addEventListener("click", () => {
        // Otherwise, Space and Enter would choose this side again in the next pair.
        document.activeElement?.blur();
        recordAnswer(side);
      });
    }
  }
  part("start").addEventListener("click", startPair);
  part("go").addEventListener("click", startPair);
  part("pause").addEventListener("click", requestPause);
  part("again").addEventListener("click", () => {
    if (!confirm("Delete these answers from this browser? Save them first.")) return;
    run = newRun();
    practiceDone = 0;
    saveRun();
    part("resume").hidden = true;
    part("start").textContent = "Start";
    showSection("intro");
  });
  document.addEventListener("visibilitychange", () => {
    if (document.visibilityState !== "hidden") return;
    if (phase === "gap") pause("Pause", "Continue when you are ready.");
    else recordAnswer(null);
  });
  addEventListener("beforeunload", (event) => {
    if (!storageWorks && run.answers.length) event.preventDefault();
  });

  countInterruptedPair();
  saveRun();
  if (nextPair() === null) {
    finish();
  } else if (run.answers.length) {
    part("resume").textContent =
      `Your last session is stored: ${run.answers.length} of ${study.pairs.length} pairs are done.`;
    part("resume").hidden = false;
    part("start").textContent = "Continue";
  }
})();
