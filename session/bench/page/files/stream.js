// The recording's events.  Whatever cuts this page off (the recording's own end, a laptop that slept), it connects again until it learns
// that there is nothing more.  A hidden page gives its connection back when another one is opened: a browser has six for all its
// tabs together.

const SILENT_MS = 5000, AGAIN_MS = 1500;

export function follow(takers, { lost, listens }) {
  const others = new BroadcastChannel("tinygc");
  let events = null, heard = performance.now(), requested = 0;
  const connect = () => {
    events?.close();
    events = new EventSource("events");
    others.postMessage("opened");
    requested = performance.now();
    for (const [name, take] of Object.entries(takers)) {
      events.addEventListener(name, event => {
        heard = performance.now();
        take(JSON.parse(event.data));
      });
    }
  };
  const close = () => {
    events?.close();
    events = null;
  };
  others.addEventListener("message", () => {
    if (document.hidden && !listens()) close();
  });
  document.addEventListener("visibilitychange", () => {
    if (!document.hidden && !events) connect();
  });
  setInterval(() => {
    const now = performance.now();
    if (!events || now - heard < SILENT_MS) return;
    lost();
    if (now - requested > AGAIN_MS + SILENT_MS * (events.readyState === EventSource.OPEN)) connect();
  }, 500);
  connect();
}
