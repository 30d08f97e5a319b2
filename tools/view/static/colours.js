// Colours of Okabe and Ito, which people with any colour vision tell apart. Nothing is told by colour
// alone: curves are dashed differently, things of the scene have shapes of their own.

export const ORANGE = "#e69f00";
export const SKY = "#56b4e9";
export const GREEN = "#009e73";
export const BLUE = "#0072b2";
export const RED = "#d55e00";
export const PURPLE = "#cc79a7";

/** Of x, y and z. */
export const AXES = [RED, GREEN, BLUE];
/** Of the curves of a plot, and how each is dashed [px]. */
export const CURVES = [BLUE, RED, GREEN, PURPLE, ORANGE, SKY];
export const DASHES = [[], [9, 4], [3, 3], [12, 4, 3, 4], [6, 2], [1, 4]];

const dark = matchMedia("(prefers-color-scheme: dark)");

/** A colour of style.css, by the scheme that holds now. */
export function ofPage(role) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${role}`).trim();
}

/** Calls now and whenever the scheme changes. */
export function eachScheme(call) {
  call();
  dark.addEventListener("change", call);
}

/** Blue is too dark on a dark page, sky too pale on a light one. */
export function readable(colour) {
  return dark.matches && colour === BLUE ? SKY : !dark.matches && colour === SKY ? "#2b87bb" : colour;
}
