// The live page: news from the server go to the picture, the plots, the scene and the panel.

import "uplot/dist/uPlot.min.css";
import "./view.css";
import { connect } from "./link.js";
import { Lessons } from "./lessons.js";
import { Panel } from "./panel.js";
import { Picture } from "./picture.js";
import { Plots } from "./plots.js";
import { Scene } from "./scene.js";

const byId = (id) => document.getElementById(id);
const STATES = { tracking: "TRACKING", lost: "LOST", recovering: "RECOVERING", searching: "SEARCHING" };

const picture = new Picture(byId("bmode"));
const plots = new Plots(byId("plots"));
let scene = null;
try {
  scene = new Scene(byId("world"), picture.image);
} catch (error) {
  // A browser without WebGL shows the rest.
  byId("scene").append(`No 3-D scene: ${error.message}`);
}
let rows = [];

const shown = () => ({ box: byId("show-box").checked, truth: byId("show-truth").checked });

function drawRow() {
  const row = rows.at(-1);
  picture.draw(row, shown());
  byId("offset").textContent = row && shown().truth ? `tip ${row.plane_offset_mm.toFixed(2)} mm off the plane${row.visible ? "" : ", out of the slice"}` : "";
  const pill = byId("state");
  pill.className = `pill ${row?.state ?? ""}`;
  pill.textContent = row ? (STATES[row.state] ?? "NO TRACKER") : "–";
  byId("words").textContent = row?.words ?? "waiting for the run";
  Object.assign(document.body.dataset, { image: row?.i ?? "", picture: picture.number ?? "", state: row?.state ?? "" });
}

function begin(about) {
  rows = [];
  byId("name").textContent = about.lesson ? `lesson: ${about.name}` : about.name;
  byId("name").title = about.setting.description;
  document.title = `${about.name} – sonoloop`;
  picture.begin(about.setting);
  plots.begin(about.setting, rows);
  scene?.begin(about);
  panel.begin(about);
  lessons.show(about);
}

const send = connect(
  (news, pixels) => {
    if (news.about) begin(news.about);
    rows.push(...news.rows);
    if (news.scene) {
      picture.show(pixels, rows.at(-1).i);
      scene?.show(news.scene);
    }
    if (news.rows.length) {
      panel.events(news.rows);
      plots.changed();
    }
    if (news.about || news.rows.length) drawRow();
    panel.show(news.status);
    document.body.dataset.run = news.run;
  },
  (reason) => {
    byId("run-state").textContent = "no connection";
    byId("words").textContent = reason ? `connection closed: ${reason}` : "connection lost; trying again";
  },
);
const panel = new Panel(send);
const lessons = new Lessons(byId("lessons"), send);

for (const id of ["show-box", "show-truth"]) byId(id).onchange = drawRow;
for (const button of document.querySelectorAll("[data-view]")) button.onclick = () => scene?.view(button.dataset.view);
