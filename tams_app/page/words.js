/**
 * What is written of the session; pure.
 *
 * All words are the robot's (`tams_app/faces/page_tables.py`), put together as the window does it
 * (`faces/banner.py`, `silence.py`, `shown.py`, `episodes.py`); a test compares the two.
 */

/**
 * @typedef {import("./messages.js").SessionState} SessionState
 * @typedef {import("./messages.js").ViewState} ViewState
 * @typedef {{ word: string, sign: string, border: string, colour: string, ink: string }} Look
 * @typedef {{ look: Look, sentence: string, key: string }} Banner
 * @typedef {Record<string, any>} Tables of `page_tables`
 */

export const LINK_LOST = "link lost";
const NOT_LIVE = "not live";
const QUIET_STATES = ["ready", "engaged", "disarmed"];

/**
 * The state as it may be shown `silentMs` after the robot's last message.
 * @param {SessionState} state @param {number} silentMs @param {number} liveMs
 * @param {number} stoppedAfterMs from then on the arm is known to be stopped
 * @returns {{ state: SessionState, silence: number | null }} silence [s]: null while it is live
 */
export function asKnown(state, silentMs, liveMs, stoppedAfterMs) {
  if (silentMs <= liveMs) return { state, silence: null };
  const arming = silentMs > stoppedAfterMs ? LINK_LOST : NOT_LIVE;
  const old = { ...state, arming, reason: "", deadman: null, pressed: [] };
  return { state: old, silence: silentMs / 1000 };
}

/** The words of one session. */
export class Words {
  #tables;
  #hand;

  /** @param {Tables} tables @param {string} hand what the operator drives with */
  constructor(tables, hand) {
    this.#tables = tables;
    this.#hand = tables["hands"][hand];
  }

  /**
   * State, reason and what to do.
   * @param {SessionState} state of `asKnown` @param {number | null} silence [s]
   * @param {boolean} shiftIsDead @returns {Banner}
   */
  banner(state, silence, shiftIsDead) {
    const { phrases, quiet, starting } = this.#tables;
    const look = this.look(state.arming);
    const stillStops = filled(phrases["not live"], { still_stops: phrases["still stops"] });
    const notReceived = filled(phrases["not received"], { seconds: silence?.toFixed(1) });
    if (state.arming === NOT_LIVE) return { look, sentence: notReceived, key: stillStops };
    if (state.arming === "holding" || state.arming === "fault") {
      const key = this.#fill(phrases[state.arming]);
      return { look, sentence: this.#reason(state), key };
    }
    let [sentence, key] = (quiet[state.arming] ?? starting).map((/** @type {string} */ one) =>
      this.#fill(one),
    );
    if (QUIET_STATES.includes(state.arming)) {
      if (state.reason) sentence += ` ${this.#reason(state)}`;
      else if (state.last_stop) sentence += ` ${filled(phrases["last stop"], { stop: state.last_stop })}`;
    } else if (silence !== null) sentence += ` ${notReceived} ${stillStops}.`;
    if (shiftIsDead && state.arming === "ready") key = phrases["shift is dead"];
    else if (state.arming === "disarmed" && state.deadman === false) key = phrases["arm"];
    else if (state.arming === "ready" && state.deadman) key = this.#fill(phrases["press again"]);
    else if (state.arming === "ready") key += this.#hand.moves;
    return { look, sentence, key };
  }

  /** @param {string} arming @returns {Look} */
  look(arming) {
    return this.#tables["looks"][arming] ?? this.#tables["looks"][""];
  }

  /**
   * The operator's next step after a stop; as `what_to_do` of `teleop/reasons.py`.
   * @param {string} held @param {string | null} lasting
   */
  whatToDo(held, lasting) {
    const { reasons, goOn } = this.#tables;
    const [label = "", ...details] = held.split(": ");
    const detail = details.join(": ");
    const reason = reasons[label];
    if (reason === undefined) return "";
    const besides = reasons[lasting || ""] ?? reason;
    if (besides !== reason) return this.#fill(besides[0]);
    if (lasting === "") return this.#fill(reason[1] || reason[0]);
    if (!detail.endsWith(".")) return this.#fill(reason[0]);
    return held.includes("confirm") ? "" : this.#fill(goOn);
  }

  /**
   * @param {string} name @param {SessionState} state
   * @param {boolean} isPinned here, where the robot may not know it yet
   */
  title(name, state, isPinned) {
    const { titles, meanings, oldMs } = this.#tables;
    const view = state.views[name];
    const isPrimary = name === state.primary_view;
    let title = name.toUpperCase();
    if (isPrimary) title += titles[state.is_pinned ? "pinned by" : "primary"];
    if (isPinned && !(isPrimary && state.is_pinned)) title += titles["pinned"];
    const ageMs = view?.age_ms ?? null;
    if (ageMs === null) return title + titles["none"];
    if (ageMs >= oldMs) return title + filled(titles["old"], { seconds: (ageMs / 1000).toFixed(1) });
    if (!(name in meanings)) return title;
    return title.replace(name.toUpperCase(), `${name.toUpperCase()}, ${meanings[name]}`);
  }

  /**
   * The cells below the headings.
   * @param {string} name @param {ViewState} view @param {number | null} askedFps
   */
  row(name, view, askedFps) {
    const { live_ssim: now, task_live_ssim: task } = view;
    return [
      name.toUpperCase(),
      `${known(view.sent_kbps)} / ${known(view.target_kbps)}`,
      `${known(view.shown_fps ?? view.given_fps)} / ${known(askedFps)}`,
      `${known(view.latency_ms)} ms`,
      `${known(view.age_ms)} ms`,
      now === null ? "" : `${known(now, 2)} / ${known(task, 2)}`,
    ];
  }

  /** The uplink's load and condition, and what makes a view late. @param {SessionState} state */
  uplink(state) {
    const sent = Object.values(state.views).flatMap((view) => view.sent_kbps ?? []);
    const values = {
      sent: known(sent.length > 0 ? sent.reduce((sum, one) => sum + one) : null),
      budget: known(state.budget_kbps),
      link: known(state.link_kbps),
      capacity: known(state.capacity_kbps),
      estimate: known(state.estimate_kbps),
      queue: known(state.queue_ms),
      loss: state.loss === null ? known(null) : known(100 * state.loss, 1),
    };
    const [load, condition] = this.#tables["uplink"];
    return [filled(load, values), filled(condition, values), this.#slowest(state)];
  }

  /** Name and word of each row about the operator's hand. @param {SessionState} state */
  hand(state) {
    const { hand, hottest } = this.#tables;
    const answer = (/** @type {string} */ row, /** @type {boolean | null} */ is) =>
      hand[row][is === null ? 0 : 1 + Number(is)];
    const motors = state.hottest_motor_c;
    const tcp = state.tcp_mm?.map((part) => Math.round(part) + 0).join(", ");
    return [
      ["deadman", answer("deadman", state.deadman)],
      ["mode", answer("mode", state.orientation_mode)],
      ["gripper", answer("gripper", state.gripper_closed)],
      ["buttons", state.pressed.join(", ") || hand["buttons"][0]],
      ["TCP", tcp === undefined ? hand["TCP"][0] : `${tcp} mm`],
      ["motors", motors === null ? hand["motors"][0] : filled(hottest, { hottest: motors })],
    ];
  }

  /** The episodes in one line, "" where there are none. @param {SessionState} state */
  episodes({ episodes }) {
    if (episodes === null) return "";
    const { episodes: words, episodeKeys: keys, askedWithinS: within } = this.#tables;
    const { doing, armed, last } = episodes;
    const seconds = episodes.seconds.toFixed(doing === "recording" ? 0 : 1);
    const isIdle = !(doing in keys) || doing === "idle";
    const asked = filled(words.asked, { armed: armed.toUpperCase(), within });
    const now = filled(words[doing] ?? words.idle, { number: episodes.number, seconds });
    const help = keys[isIdle && last.at(-1)?.kept ? "kept" : isIdle ? "idle" : doing];
    return [now, armed ? asked : help, filled(words.counts, episodes)].join(" · ");
  }

  /** @param {SessionState} state */
  #slowest(state) {
    const { slowest, toTheUplink, notableMs, remedies, otherRemedy, stages } = this.#tables;
    const view = state.views[state.primary_view];
    const own = view?.own ?? null;
    if (own === null || own.total_ms < notableMs) return "";
    return filled(slowest, {
      view: state.primary_view.toUpperCase(),
      total: own.total_ms,
      upto: view?.shown_fps === null ? toTheUplink : "",
      stage: stages[own.slowest] ?? stages[""],
      ms: own.slowest_ms,
      remedy: remedies[own.slowest] ?? otherRemedy,
    });
  }

  /** @param {SessionState} state */
  #reason(state) {
    let reason = capital(state.reason);
    if (reason && !reason.endsWith(".")) reason += ".";
    const advice = this.whatToDo(state.reason, state.lasting);
    return `${reason} ${advice}`.trim() || this.#tables["phrases"]["stopped"];
  }

  /** @param {string} sentence */
  #fill(sentence) {
    return capital(filled(sentence, this.#hand));
  }
}

/** Minutes and seconds. @param {number} seconds */
export function minutes(seconds) {
  const whole = Math.floor(seconds);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

/** A number, a dash for what is not known. @param {number | null} value @param {number} [digits] */
export function known(value, digits = 0) {
  return value === null ? "–" : value.toFixed(digits);
}

/** @param {string} sentence @param {object} values */
function filled(sentence, values) {
  return sentence.replace(/\{(\w+)\}/g, (_, name) =>
    String(/** @type {Record<string, unknown>} */ (values)[name] ?? ""),
  );
}

/** @param {string} sentence */
function capital(sentence) {
  return sentence.slice(0, 1).toUpperCase() + sentence.slice(1);
}
