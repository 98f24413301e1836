// What hands can do: run, hold, step, pace, restart, disturb, tune.

const byId = (id) => document.getElementById(id);
const number = (id) => Number(byId(id).value);
const UNITS = { elevation: "mm", yaw: "°", tilt: "°", dim: "dB" };
const LIFT = { height_mm: 5, duration_s: 1 };
const DOWN_S = 1;
const MOST_EVENTS = 60;

/** What was asked for stands there as JSON; people read words. */
const readable = (text) => (/^["{]/.test(text) ? `asked: ${text.replaceAll(/["{}]/g, "").replaceAll(/[:,_]/g, (mark) => (mark === "_" ? " " : `${mark} `))}` : text);

export class Panel {
  constructor(send) {
    this.send = send;
    const control = (request) => send({ control: request });
    const disturb = (entry) => control({ disturb: entry });
    byId("run").onclick = () => {
      if (this.status?.over) this.restart();
      else control(this.status?.held ? "resume" : "pause");
    };
    byId("step").onclick = () => control({ step: 1 });
    byId("speed").onchange = () => control({ speed: byId("speed").value === "max" ? null : number("speed") });
    byId("restart").onclick = () => this.restart();
    byId("next-seed").onclick = () => {
      byId("seed").value = number("seed") + 1;
      this.restart();
    };
    for (const [id, unit] of Object.entries(UNITS)) {
      const slider = byId(id);
      const tell = () => { slider.parentElement.querySelector("output").textContent = `${slider.value} ${unit}`; };
      slider.addEventListener("input", tell);
      tell();
    }
    byId("knock").onclick = () => disturb({ probe_knock: { elevation_mm: number("elevation"), yaw_deg: number("yaw"), tilt_deg: number("tilt") } });
    byId("dim").onchange = () => disturb({ needle_brightness: { gain_db: number("dim") } });
    byId("lift").onclick = () => disturb({ lift_off: LIFT });
    byId("kill").onclick = () => disturb({ tracker_killed: { down_s: DOWN_S } });
    byId("settings").onsubmit = (event) => {
      event.preventDefault();
      this.restart({ set: this.changes() });
    };
    byId("reset").onclick = () => this.restart({ set: [] });
    const tabs = [...document.querySelectorAll("nav [role=tab]")];
    for (const tab of tabs) {
      tab.onclick = () => {
        for (const other of tabs) {
          other.setAttribute("aria-selected", String(other === tab));
          byId(other.dataset.tab).hidden = other !== tab;
        }
      };
    }
    addEventListener("keydown", (event) => {
      if (event.target.matches("input, select, textarea, button, summary") || event.ctrlKey || event.metaKey) return;
      if (event.key === " ") byId("run").click();
      else if (event.key === ".") byId("step").click();
      else return;
      event.preventDefault();
    });
  }

  restart(more = {}) {
    this.send({ restart: { seed: Math.max(0, Math.floor(number("seed"))), ...more } });
  }

  begin(about) {
    byId("seed").value = about.seed;
    byId("dim").value = 0;
    byId("dim").dispatchEvent(new Event("input"));
    byId("events").replaceChildren();
    this.fields(about);
  }

  fields({ form, set }) {
    const changed = new Map(set.map((pair) => [pair.slice(0, pair.indexOf("=")), pair]));
    this.keep = set;
    const labels = form.map(({ key, label, value, choices }) => {
      const element = document.createElement("label");
      element.textContent = label;
      element.title = key;
      const input = element.appendChild(document.createElement(choices.length ? "select" : "input"));
      for (const choice of choices) input.add(new Option(choice.replaceAll("_", " "), choice));
      input.value = value;
      Object.assign(input.dataset, { key, was: value });
      input.classList.toggle("changed", changed.has(key));
      input.addEventListener("input", () => input.classList.toggle("changed", changed.has(key) || input.value !== value));
      return element;
    });
    byId("fields").replaceChildren(...labels);
  }

  /** The values changed so far and those changed now, as key=value. */
  changes() {
    const set = new Map(this.keep.map((pair) => [pair.slice(0, pair.indexOf("=")), pair]));
    for (const { dataset: { key, was }, value } of byId("fields").querySelectorAll("input, select")) {
      if (value !== was) set.set(key, `${key}=${value}`);
    }
    return [...set.values()];
  }

  show(status) {
    this.status = status;
    const { held, over, speed, complaint } = status;
    byId("run").textContent = over ? "again" : held ? "run" : "pause";
    byId("speed").value = speed === null ? "max" : String(speed);
    for (const id of ["step", "knock", "lift", "kill", "dim"]) byId(id).disabled = Boolean(over);
    const pill = byId("run-state");
    pill.className = `pill ${over ? (over.pass ? "pass" : "fail") : ""}`;
    pill.textContent = over ? `${over.pass ? "PASS" : "FAIL"}: ${over.end}` : held ? "paused" : "running";
    pill.title = over ? over.failed.join("\n") : "";
    byId("complaint").hidden = !complaint;
    byId("complaint").textContent = complaint ?? "";
  }

  events(rows) {
    const list = byId("events");
    for (const { t_s, text } of rows.flatMap((row) => row.events)) {
      const item = document.createElement("li");
      item.textContent = `${t_s.toFixed(2)} s  ${readable(text)}`;
      list.prepend(item);
    }
    while (list.children.length > MOST_EVENTS) list.lastChild.remove();
  }
}
