// Sound of alarms: the beep and how often it comes.

const BEEP_S = 0.14;
const PERIOD_S = 0.22;
const VOLUME = 0.08;
const ALARM_HZ = 880;
const WARNING_HZ = 560;

export class AlarmSound {
  constructor() {
    this.isMuted = localStorage.getItem("muted") === "yes";
    /** @type {AudioContext | null} */
    this.audio = null;
    // Browsers play no sound before the user has touched the page.
    document.addEventListener("pointerdown", () => this.allow(), { once: true });
    document.addEventListener("keydown", () => this.allow(), { once: true });
  }

  allow() {
    this.audio ??= new AudioContext();
  }

  toggle() {
    this.isMuted = !this.isMuted;
    localStorage.setItem("muted", this.isMuted ? "yes" : "no");
  }

  /** @param {number} urgency 2 for an alarm, 1 for a warning */
  play(urgency) {
    const { audio } = this;
    if (this.isMuted || !audio) return;
    for (let beep = 0; beep < urgency; beep++) {
      const start = audio.currentTime + beep * PERIOD_S;
      const tone = new OscillatorNode(audio, { frequency: urgency === 2 ? ALARM_HZ : WARNING_HZ });
      tone.connect(new GainNode(audio, { gain: VOLUME })).connect(audio.destination);
      tone.start(start);
      tone.stop(start + BEEP_S);
    }
  }
}
