// Tones for what changes.  Browsers allow none before somebody has pressed a key or clicked: the first of these turns them on.

const TONES = { ready: [880], accepted: [660, 880], rejected: [330, 220], warning: [330, 330], done: [660, 880, 1100] };
let context = null, refused = false;

export function soundButton(button) {
  const show = () => {
    button.setAttribute("aria-pressed", String(Boolean(context)));
    button.textContent = context ? "sound is on" : refused ? "sound is off" : "sound: any key";
  };
  const on = () => {
    if (context || refused) return;
    context = new AudioContext();
    play("ready");
    show();
  };
  button.addEventListener("click", event => {
    event.stopPropagation();
    refused = Boolean(context);
    context?.close();
    context = null;
    if (!refused) on();
    show();
  });
  addEventListener("keydown", on);
  addEventListener("click", on);
  show();
}

export const soundIsOn = () => Boolean(context);

export function play(kind) {
  if (!context) return;
  (TONES[kind] || []).forEach((hertz, i) => {
    const tone = context.createOscillator(), loudness = context.createGain(), begins = context.currentTime + 0.16 * i;
    tone.frequency.value = hertz;
    loudness.gain.setValueAtTime(0.25, begins);
    loudness.gain.exponentialRampToValueAtTime(0.001, begins + 0.15);
    tone.connect(loudness).connect(context.destination);
    tone.start(begins);
    tone.stop(begins + 0.15);
  });
}
