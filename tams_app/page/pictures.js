/** The views on the page: each on a canvas of its own, one of them large. */

const STAYS_MS = 800; // so that a short phase does not throw the views to and fro

export class Pictures {
  #views;
  #large = 0;
  #changedMs = -Infinity;
  /** @type {{ figure: HTMLElement, title: HTMLElement, context: CanvasRenderingContext2D }[]} */
  #parts;

  /**
   * @param {HTMLElement} into @param {{ views: string[], width: number, height: number }} video
   * @param {string[]} colours
   */
  constructor(into, { views, width, height }, colours) {
    this.#views = views;
    this.#parts = views.map((name, place) => {
      const figure = document.createElement("figure");
      const canvas = document.createElement("canvas");
      const title = document.createElement("figcaption");
      Object.assign(canvas, { width, height });
      figure.dataset["tams"] = `view-${name}`;
      title.dataset["tams"] = `title-${name}`;
      figure.style.setProperty("--view", colours[place % colours.length] ?? "");
      figure.append(canvas, title);
      const context = canvas.getContext("2d", { alpha: false, desynchronized: true });
      if (context === null) throw new Error("this browser gives no canvas");
      return { figure, title, context };
    });
    into.style.setProperty("--others", String(Math.max(1, views.length - 1)));
    into.replaceChildren(...this.#parts.map(({ figure }) => figure));
    this.#place();
  }

  /** Takes the frame over. @param {number} place @param {VideoFrame} frame */
  draw(place, frame) {
    const context = this.#parts[place]?.context;
    context?.drawImage(frame, 0, 0, context.canvas.width, context.canvas.height);
    frame.close();
  }

  /** @param {number} place @param {string} title @param {boolean} isOld */
  title(place, title, isOld) {
    const parts = this.#parts[place];
    if (parts === undefined) return;
    if (parts.title.textContent !== title) parts.title.textContent = title;
    parts.figure.classList.toggle("old", isOld);
  }

  /** The view that comes after the large one. */
  get next() {
    return (this.#large + 1) % this.#views.length;
  }

  /**
   * The primary view has the large place, but for a pinned one.
   * @param {string} primary @param {number | null} pinned @param {number} nowMs
   */
  follow(primary, pinned, nowMs) {
    const wanted = pinned ?? this.#views.indexOf(primary);
    if (wanted < 0 || wanted === this.#large) return;
    if (pinned === null && nowMs - this.#changedMs < STAYS_MS) return;
    this.#large = wanted;
    this.#changedMs = nowMs;
    this.#place();
  }

  #place() {
    for (const [place, { figure }] of this.#parts.entries()) {
      figure.classList.toggle("large", place === this.#large);
    }
  }
}
