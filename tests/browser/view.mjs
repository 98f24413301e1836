// Uses the live page in headless Chromium as a student would.
//
//   node tests/browser/view.mjs PROGRAM [FOLDER]      PROGRAM is the built sonoloop; pictures of the page go into FOLDER
//
// Fails on any request beside the page's own, any message of an error, and anything that does not answer. Needs playwright-core,
// found as reports.mjs finds it.

import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import { createRequire } from "node:module";
import { resolve } from "node:path";
import { createInterface } from "node:readline";

const FLAGS = [
  "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
  "--disable-sync", "--enable-unsafe-swiftshader",
];
/** Longest that anything may take that must come. */
const PATIENCE_MS = 90_000;

const from = process.env.PLAYWRIGHT ? `${resolve(process.env.PLAYWRIGHT)}/` : import.meta.url;
const { chromium } = createRequire(from)("playwright-core");
const executablePath = process.env.CHROMIUM || execFileSync("which", ["chromium"], { encoding: "utf8" }).trim();
const [program, folder] = process.argv.slice(2);
assert.ok(program, "name the program");

/** Starts the server; resolves with it and its address. */
function serve(...more) {
  const server = spawn(program, ["view", "scenarios/lateral_plain.yaml", "--port", "0", ...more], { stdio: ["ignore", "ignore", "pipe"] });
  const lines = createInterface({ input: server.stderr });
  return new Promise((done, failed) => {
    server.on("exit", (code) => failed(new Error(`the server ended with ${code}`)));
    lines.on("line", (line) => {
      const [url] = line.match(/http:\/\/\S+/) ?? [];
      if (url) done({ server, url });
      else console.error(line);
    });
  });
}

const complaints = [];
async function open(browser, url, options) {
  const page = await browser.newPage({ viewport: { width: 1280, height: 720 }, ...options });
  page.setDefaultTimeout(PATIENCE_MS);
  page.on("console", (message) => {
    // The software renderer says that reading back a picture for a screenshot was slow.
    if (!/GPU stall|GL Driver Message/.test(message.text())) complaints.push(`console: ${message.type()}: ${message.text()}`);
  });
  page.on("pageerror", (error) => complaints.push(`error: ${error.message}`));
  page.on("request", (request) => {
    if (!request.url().startsWith(url) && !/^(data|blob):/.test(request.url())) complaints.push(`request: ${request.url()}`);
  });
  await page.goto(url);
  return page;
}

const at = (page) => page.evaluate(() => ({ ...document.body.dataset }));
const imageOf = async (page) => Number((await at(page)).image);
const until = (page, state) => page.waitForFunction((wanted) => document.body.dataset.state === wanted, state);
const says = (page, text) => page.waitForFunction((wanted) => document.getElementById("run-state").textContent.startsWith(wanted), text);
const take = async (page, name) => folder && page.screenshot({ path: `${folder}/${name}.png` });

/** Lightest grey of the picture and a number that changes with any pixel. */
const picture = (page) => page.$eval("#bmode", (canvas) => {
  const copy = Object.assign(document.createElement("canvas"), { width: canvas.width, height: canvas.height });
  const context = copy.getContext("2d", { willReadFrequently: true });
  context.drawImage(canvas, 0, 0);
  const { data } = context.getImageData(50, 0, copy.width - 50, copy.height);
  return data.reduce(([most, sum], value, k) => (k % 4 ? [most, sum] : [Math.max(most, value), (sum * 31 + value) % 1_000_003]), [0, 0]);
});

async function slide(page, id, value) {
  await page.locator(`#${id}`).fill(String(value));
  assert.match(await page.locator(`label:has(#${id}) output`).textContent(), new RegExp(`^${value} `));
}

async function use(browser, url) {
  const page = await open(browser, url);
  await until(page, "tracking");
  await page.locator("#run").click();
  await says(page, "paused");

  const before = [await imageOf(page), await picture(page)];
  assert.ok(before[1][0] > 60, "a picture is drawn");
  for (let k = 1; k <= 3; k += 1) {
    await page.locator("#step").click();
    await page.waitForFunction((image) => Number(document.body.dataset.image) > image, before[0] + k - 1);
    assert.equal(await imageOf(page), before[0] + k, "a step is one image");
    assert.equal(Number((await at(page)).picture), before[0] + k, "and its picture is shown");
  }
  await page.waitForTimeout(400);
  assert.equal(await imageOf(page), before[0] + 3, "and no more");
  assert.notDeepEqual(await picture(page), before[1]);

  const other = await open(browser, url);
  await other.waitForFunction((image) => Number(document.body.dataset.image) === image, before[0] + 3);
  assert.equal(await other.locator("#words").textContent(), await page.locator("#words").textContent(), "a second browser sees the same");
  await other.reload();
  await other.waitForFunction((image) => Number(document.body.dataset.image) === image, before[0] + 3);
  const points = await other.evaluate(() => document.querySelectorAll("#plots canvas").length);
  assert.equal(points, 4, "a reload has the plots again");

  const plain = await picture(page);
  await page.getByLabel("truth").check();
  assert.notDeepEqual(await picture(page), plain, "the truth is drawn when asked for");
  assert.match(await page.locator("#offset").textContent(), /mm off the plane/);
  await take(page, "tracking");

  await slide(page, "elevation", 3);
  await page.locator("#knock").click();
  await page.locator("#run").click();
  await until(page, "lost");
  assert.match(await page.locator("#words").textContent(), /^lost at \d+\.\d s: .*(needle stopped|needle at)/);
  await page.waitForFunction(() => /needle stopped; searching [+-]\d/.test(document.getElementById("words").textContent));
  await take(page, "lost");
  await until(other, "lost");
  await until(page, "tracking");
  assert.match(await page.locator("#events").textContent(), /probe slips/, "what happened is listed");
  for (const view of ["whole", "top", "side", "along needle", "near"]) {
    const drawn = Number(await page.locator("#world").getAttribute("data-drawn"));
    await page.getByRole("button", { name: view, exact: true }).click();
    await page.waitForFunction((count) => Number(document.getElementById("world").dataset.drawn) > count, drawn);
    await page.waitForTimeout(150);
    await take(page, `view_${view.replace(" ", "_")}`);
  }
  await page.locator("#speed").selectOption("max");
  await page.waitForFunction(() => /^(PASS|FAIL): /.test(document.getElementById("run-state").textContent));
  await take(page, "over");

  // What the form refuses names key, value and bound; what it takes begins a run with the same seed.
  await page.getByRole("tab", { name: "Settings" }).click();
  const field = page.locator("[data-key='tracker.template_px']");
  await field.fill("9999");
  await page.locator("#settings .main").click();
  await page.waitForFunction(() => /template_px.*9999/s.test(document.getElementById("complaint").textContent));
  await take(page, "complaint");
  await field.fill("24");
  await page.locator("#settings .main").click();
  await page.waitForFunction(() => document.body.dataset.run === "2");
  await page.waitForFunction(() => document.querySelector("[data-key='tracker.template_px']").value === "24");
  assert.equal(await page.locator("#seed").inputValue(), "0");
  await page.locator("#seed").fill("5");
  await page.locator("#restart").click();
  await page.waitForFunction(() => document.body.dataset.run === "3");
  assert.equal(await page.locator("#seed").inputValue(), "5");
  await take(page, "settings");
  await other.close();

  await page.getByRole("tab", { name: "Lessons" }).click();
  const titles = await page.locator(".lesson-list button").allTextContents();
  assert.equal(titles.length, 6);
  for (const [k, title] of titles.entries()) {
    await page.getByRole("button", { name: title, exact: true }).click();
    await page.locator(".lesson details summary").click();
    assert.ok(await page.locator(".lesson details p").first().isVisible(), "the answer is shown when asked for");
    await page.locator(".lesson-start").click();
    await page.waitForFunction((run) => document.body.dataset.run === run, String(4 + k));
    await page.waitForFunction(() => document.body.dataset.image !== "");
    await take(page, `lesson_${k + 1}`);
    await page.getByRole("button", { name: "all lessons" }).click();
  }
  await page.close();

  const dark = await open(browser, url, { colorScheme: "dark" });
  await until(dark, "tracking");
  await dark.waitForTimeout(500);
  await take(dark, "dark");
  await dark.close();
}

const { server, url } = await serve();
const browser = await chromium.launch({ executablePath, args: FLAGS });
try {
  await use(browser, url);
  assert.deepEqual(complaints, []);
  console.log("the page: no other request, no complaint");
} finally {
  await browser.close();
  server.removeAllListeners("exit");
  server.kill("SIGINT");
}
