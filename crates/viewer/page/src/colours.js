/** A colour of the style sheet, light or dark as the page is. */
export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

export const STATE_COLOURS = { tracking: "green", lost: "red", recovering: "amber", searching: "blue" };
/** Over the picture, which is dark in every theme. */
export const OVER = { tracking: "#40d660", lost: "#ff524a", recovering: "#ffb81c", searching: "#68a8ff", truth: "#40e0e8", scale: "#b8c2cc" };
