// Shows the progress of a verification, and reads an anchor's file into the form.
"use strict";
(() => {
  const PAUSE = 500;

  async function follow() {
    const part = document.getElementById("verification");
    const address = part && part.dataset.progress;
    if (!address) return;
    try {
      const { running } = await (await fetch(address)).json();
      if (!running) return location.reload();
      const bar = document.getElementById("progress");
      if (bar && running.total) {
        bar.max = running.total;
        bar.value = running.done;
        const format = (number) => number.toLocaleString("en");
        document.getElementById("checked").textContent = `${format(running.done)} of ${format(running.total)}`;
      }
    } catch {
      // The server may be starting again.
    }
    setTimeout(follow, PAUSE);
  }

  const file = document.getElementById("anchor-file");
  file.addEventListener("change", async () => {
    if (file.files.length) document.getElementById("anchor").value = await file.files[0].text();
  });
  follow();
})();
