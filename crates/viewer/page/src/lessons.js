// Lessons: Markdown from the server, each with a scenario that it starts. The answer is shown when asked for.

import { marked } from "marked";

const ANSWER = /^## Answer\s*$/m;

export class Lessons {
  constructor(root, send) {
    this.root = root;
    this.send = send;
    this.open = null;
  }

  show({ lessons, lesson }) {
    this.lessons = lessons;
    this.running = lesson;
    if (lesson && this.open === null) this.open = lesson;
    this.draw();
  }

  draw() {
    const lesson = this.lessons.find(({ name }) => name === this.open);
    if (lesson) this.drawOne(lesson);
    else this.drawList();
  }

  drawList() {
    const list = document.createElement("ul");
    list.className = "lesson-list";
    list.append(...this.lessons.map(({ name, title }) => {
      const item = document.createElement("li");
      item.append(this.button(title, () => this.to(name)));
      return item;
    }));
    if (!this.lessons.length) list.textContent = "No lessons in the folder that --lessons names.";
    this.root.replaceChildren(list);
  }

  drawOne({ name, text }) {
    const [body, answer] = text.split(ANSWER);
    const article = document.createElement("article");
    article.className = "lesson";
    article.innerHTML = marked.parse(body);
    if (answer) {
      const details = article.appendChild(document.createElement("details"));
      details.appendChild(document.createElement("summary")).textContent = "Answer";
      details.insertAdjacentHTML("beforeend", marked.parse(answer));
    }
    const start = this.button(this.running === name ? "start again" : "start this lesson's run", () => this.send({ restart: { lesson: name } }));
    start.className = "main lesson-start";
    const row = document.createElement("div");
    row.className = "row";
    row.append(start, this.button("all lessons", () => this.to("")));
    if (this.running) row.append(this.button("leave", () => this.send({ restart: { lesson: "" } })));
    this.root.replaceChildren(row, article);
  }

  to(name) {
    this.open = name;
    this.draw();
  }

  button(text, onclick) {
    return Object.assign(document.createElement("button"), { type: "button", textContent: text, onclick });
  }
}
