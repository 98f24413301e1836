// Opens reports in headless Chromium, light and dark, and uses them as a reader would.
//
//   node tests/browser/reports.mjs REPORT.html…       CHROMIUM names the browser, else the one in PATH is taken
//
// Fails on any request beside the page itself, any message of an error, and anything that does not answer. Needs the npm package
// playwright-core, found from the folder in PLAYWRIGHT (one that has node_modules) or from here.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { statSync } from "node:fs";
import { createRequire } from "node:module";
import { resolve } from "node:path";
import { pathToFileURL } from "node:url";

const MOST_BYTES = 15_000_000;
const FLAGS = [
  "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
  "--disable-sync", "--enable-unsafe-swiftshader",
];

const from = process.env.PLAYWRIGHT ? `${resolve(process.env.PLAYWRIGHT)}/` : import.meta.url;
const { chromium } = createRequire(from)("playwright-core");
const executablePath = process.env.CHROMIUM || execFileSync("which", ["chromium"], { encoding: "utf8" }).trim();

/** What the picture in the player looks like: its lightest grey, and a number that changes with any pixel. */
const picture = (page) => page.$eval(".player canvas", (canvas) => {
  // From a copy: reading the page's own canvas would make the browser complain of the test.
  const copy = Object.assign(document.createElement("canvas"), { width: canvas.width, height: canvas.height });
  const context = copy.getContext("2d", { willReadFrequently: true });
  context.drawImage(canvas, 0, 0);
  const { data } = context.getImageData(0, 0, copy.width, copy.height);
  let [lightest, sum] = [0, 0];
  for (let k = 0; k < data.length; k += 4) {
    lightest = Math.max(lightest, data[k]);
    sum = (sum * 31 + data[k]) % 1_000_003;
  }
  return { lightest, sum };
});

async function usePlayer(page) {
  const slider = page.locator(".player input[type=range]");
  const at = async () => Number(await slider.inputValue());
  const last = Number(await slider.getAttribute("max"));
  assert.equal(await at(), 0);
  assert.ok((await picture(page)).lightest > 60, "a picture is drawn");
  await page.keyboard.press("ArrowRight");
  assert.equal(await at(), 1, "the arrow key goes to the next image");
  await page.keyboard.press("Shift+ArrowRight");
  assert.equal(await at(), 11, "with shift by ten");
  await page.keyboard.press("ArrowLeft");
  assert.equal(await at(), 10, "and back");
  await page.evaluate(() => document.activeElement?.blur());

  const over = page.locator(".u-over").nth(1);
  await over.scrollIntoViewIfNeeded();
  const plot = await over.boundingBox();
  await page.mouse.move(plot.x + plot.width / 2, plot.y + plot.height / 2);
  await page.waitForTimeout(100);
  const middle = await at();
  assert.ok(Math.abs(middle - last / 2) < 0.05 * last + 2, `the pointer in the middle of a plot leads there: ${middle} of ${last}`);
  const lines = await page.$$eval(".u-cursor-x", (all) => all.map((line) => line.style.transform));
  assert.equal(new Set(lines).size, 1, "all plots have one cursor");
  await page.mouse.move(2, 2);
  await page.waitForTimeout(100);
  assert.equal(await at(), middle, "the cursor stays when the pointer leaves");
  assert.equal(await page.locator(".u-cursor-x.u-off, .u-cursor-x[style*='-10px']").count(), 0, "and is still shown");

  const [before, truth] = [await picture(page), page.getByLabel("truth")];
  assert.equal(await page.locator(".player dl div:visible", { hasText: "tip error" }).count(), 0, "the truth is hidden");
  await truth.check();
  assert.notDeepEqual(await picture(page), before, "and drawn when asked for");
  assert.equal(await page.locator(".player dl div:visible", { hasText: "tip error" }).count(), 1);
  await truth.uncheck();
  assert.deepEqual(await picture(page), before);

  await page.locator("tr[data-at]").last().click();
  assert.ok((await at()) >= last - 12, "the last event leads to the end");
  await page.locator(".player button").click();
  await page.waitForTimeout(400);
  await page.locator(".player button").click();
}

async function check(browser, file) {
  const bytes = statSync(file).size;
  assert.ok(bytes <= MOST_BYTES, `${bytes} bytes`);
  for (const colorScheme of ["light", "dark"]) {
    const page = await browser.newPage({ viewport: { width: 1300, height: 900 }, colorScheme });
    const complaints = [];
    const own = pathToFileURL(resolve(file)).href;
    page.on("console", (message) => complaints.push(`console: ${message.type()}: ${message.text()}`));
    page.on("pageerror", (error) => complaints.push(`error: ${error.message}`));
    page.on("requestfailed", (request) => complaints.push(`failed: ${request.url().slice(0, 120)}`));
    page.on("request", (request) => {
      if (request.url() !== own && !/^(data|blob):/.test(request.url())) complaints.push(`request: ${request.url()}`);
    });
    await page.goto(own);
    await page.waitForTimeout(300);
    assert.match(await page.textContent("header"), /Not for clinical use/);
    const paper = await page.evaluate(() => getComputedStyle(document.body).backgroundColor);
    assert.equal(paper === "rgb(255, 255, 255)", colorScheme === "light", `background ${paper}`);
    const wide = await page.evaluate(() => document.documentElement.scrollWidth > document.documentElement.clientWidth);
    assert.ok(!wide, "nothing sticks out at the side");
    assert.equal(await page.locator(".charts:not(:has(canvas))").count(), 0, "all charts are drawn");
    if (await page.locator(".player").count()) await usePlayer(page);
    const printed = await page.pdf({ format: "A4", printBackground: false });
    assert.ok(printed.length > 10_000, "it can be printed");
    assert.deepEqual(complaints, []);
    await page.close();
  }
  console.log(`${file}: ${(bytes / 1e6).toFixed(1)} MB, no request, no complaint`);
}

const files = process.argv.slice(2);
assert.ok(files.length > 0, "name at least one report");
const browser = await chromium.launch({ executablePath, args: FLAGS });
try {
  for (const file of files) await check(browser, file);
} finally {
  await browser.close();
}
