// Follows the knowledge base of the page: what has `data-live` and an id is brought up to date in
// place, and the rest of the page stays as it is. A page of the past has no such parts.
"use strict";
(() => {
  const status = document.getElementById("live");
  if (!status || !window.EventSource) return;
  const PAUSE = 1000, RETRY = 3000;
  let head = Number(status.dataset.head);
  let source = null, isLost = false, timer = null, isStale = false;

  function connect() {
    if (source || document.hidden) return;
    const address = new URL(status.dataset.feed, location.href);
    address.searchParams.set("after", head);
    source = new EventSource(address);
    source.addEventListener("open", () => {
      if (isLost) say("Connected again.");
      isLost = false;
    });
    source.addEventListener("revision", (event) => happened(JSON.parse(event.data)));
    source.addEventListener("error", () => {
      if (!isLost) say("The server does not answer; trying again.");
      isLost = true;
      // After an answer that is no stream, the browser itself does not try again.
      if (source && source.readyState === EventSource.CLOSED) {
        disconnect();
        setTimeout(connect, RETRY);
      }
    });
  }

  function disconnect() {
    if (source) source.close();
    source = null;
  }

  function happened(revision) {
    if (revision.revision === head) return;
    head = revision.revision;
    say(revision.message, revision);
    isStale = true;
    if (!timer) refresh();
  }

  function say(message, revision) {
    const text = document.createElement("bdi");
    text.textContent = message;
    if (!revision || revision.knowledge_base === null) {
      status.replaceChildren(text);
      return;
    }
    const link = document.createElement("a");
    const query = new URLSearchParams({ kb: revision.knowledge_base, number: revision.revision });
    link.href = `/revision?${query}`;
    link.append(text);
    status.replaceChildren(link);
  }

  async function refresh() {
    timer = setTimeout(() => {
      timer = null;
      if (isStale) refresh();
    }, PAUSE);
    isStale = false;
    if (!document.querySelector("[data-live][id]")) return;
    try {
      const answer = await fetch(location.href, { headers: { Accept: "text/html" } });
      if (answer.ok) update(new DOMParser().parseFromString(await answer.text(), "text/html"));
    } catch {
      isStale = true;
    }
  }

  function update(page) {
    window.kantTimes?.(page);
    for (const part of document.querySelectorAll("[data-live][id]")) {
      const fresh = page.getElementById(part.id);
      const isTyping = part.contains(document.activeElement) && document.activeElement.matches("input, select, textarea");
      if (!fresh || isTyping || fresh.innerHTML === part.innerHTML) continue;
      const focused = part.contains(document.activeElement) ? document.activeElement : null;
      part.replaceChildren(...fresh.childNodes);
      if (focused) refocus(part, focused);
    }
  }

  function refocus(part, focused) {
    const address = focused.getAttribute("href");
    const same = [...part.querySelectorAll(focused.tagName)].find(
      (each) => (focused.id && each.id === focused.id) || (address && each.getAttribute("href") === address),
    );
    (same || document.getElementById("content")).focus({ preventScroll: true });
  }

  // A browser opens only six connections to a server: hidden pages give theirs back.
  document.addEventListener("visibilitychange", () => (document.hidden ? disconnect() : connect()));
  addEventListener("pagehide", disconnect);
  addEventListener("pageshow", connect);
  connect();
})();
