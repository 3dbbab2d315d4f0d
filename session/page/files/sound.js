// Tones for what changes: off until somebody clicks, as browsers ask.

const TONES = { ready: [880], accepted: [660, 880], rejected: [330, 220], warning: [330, 330], done: [660, 880, 1100] };
let context = null;

export function soundButton(button) {
  button.addEventListener("click", () => {
    if (context) {
      context.close();
      context = null;
    } else {
      context = new AudioContext();
      play("ready");
    }
    button.setAttribute("aria-pressed", String(Boolean(context)));
    button.textContent = context ? "sound is on" : "sound is off";
  });
}

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
