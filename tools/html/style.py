"""How a report looks: one style sheet, light and dark, for a phone and for a desk."""

from __future__ import annotations

from hoap3.tools.html.palette import DARK, LIGHT


def _variables(colours: dict[str, str]) -> str:
    return " ".join(f"--{role}: {value};" for role, value in colours.items())


STYLE = (
    f":root {{ color-scheme: light dark; {_variables(LIGHT)} }}\n"
    f"@media (prefers-color-scheme: dark) {{ :root {{ {_variables(DARK)} }} }}\n"
    """
* { box-sizing: border-box; }
html { scroll-behavior: smooth; scroll-padding-top: 1rem; -webkit-text-size-adjust: 100%; }
body {
  margin: 0; background: var(--page); color: var(--ink);
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", sans-serif;
}
main, header, footer { max-width: 75rem; margin: 0 auto; padding: 0 clamp(0.9rem, 3vw, 2rem); }
header { padding-top: clamp(1.2rem, 4vw, 2.6rem); }
h1 { font-size: clamp(1.5rem, 4vw, 2.1rem); line-height: 1.2; margin: 0 0 0.3rem; font-weight: 650;
  letter-spacing: -0.015em; overflow-wrap: anywhere; }
.verdicts { margin: 0.8rem 0; } .verdicts p { margin: 0.2rem 0; overflow-wrap: anywhere; }
h2 { font-size: 1.3rem; margin: 2.8rem 0 0.9rem; font-weight: 650; letter-spacing: -0.01em; }
h3 { font-size: 1rem; margin: 0; font-weight: 600; line-height: 1.35; }
p { margin: 0.5rem 0; max-width: 46rem; }
a { color: inherit; text-decoration-color: var(--faint); text-underline-offset: 0.2em; }
a:hover { text-decoration-color: currentColor; }
.sub { color: var(--soft); margin: 0; overflow-wrap: anywhere; }
.badge { display: inline-block; padding: 0.05em 0.6em; border-radius: 0.4em; color: var(--card);
  font-size: 0.75em; vertical-align: 0.12em; margin-left: 0.4em; letter-spacing: 0.02em; }
.fit, .good { background: var(--green); } .warn { background: var(--orange); }
.unfit, .bad { background: var(--red); } .unknown { background: var(--soft); }
nav { margin: 1.1rem 0 0; display: flex; flex-wrap: wrap; gap: 0.2rem 1.1rem; font-size: 0.92rem; }
nav a { color: var(--soft); text-decoration: none; }
nav a:hover { color: var(--ink); }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(10.5rem, 1fr));
  gap: 0.8rem; margin: 1.6rem 0 0; padding: 0; list-style: none; }
.tile { background: var(--card); border: 1px solid var(--rule); border-radius: 0.6rem;
  padding: 0.75rem 0.95rem; }
.tile b { display: block; font-size: 1.45rem; font-weight: 620; line-height: 1.25;
  font-variant-numeric: tabular-nums; letter-spacing: -0.01em; }
.tile span { display: block; color: var(--soft); font-size: 0.83rem; line-height: 1.4; }
.tile .name { color: var(--ink); }
.gaps { border-left: 3px solid var(--orange); padding: 0.1rem 0 0.1rem 1rem; margin: 1.4rem 0 0; }
.grid { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 27rem), 1fr));
  gap: 1rem; }
figure { margin: 0; background: var(--card); border: 1px solid var(--rule); border-radius: 0.6rem;
  padding: 0.95rem 1.05rem; min-width: 0; display: flex; flex-direction: column; }
figure svg { width: 100%; height: auto; display: block; margin: 0.5rem 0 0.3rem;
  stroke-linejoin: round; stroke-linecap: butt; }
figure svg text { font-family: inherit; }
.legend { display: flex; flex-wrap: wrap; gap: 0.15rem 0.95rem; list-style: none; margin: 0;
  padding: 0; font-size: 0.83rem; }
.legend li { display: flex; align-items: center; gap: 0.4rem; overflow-wrap: anywhere; }
.mark { flex: none; width: 1.1rem; height: 0; border-top: 3px solid; }
.mark.dash { border-top: 2px dashed; }
.mark.area { height: 0.75rem; border: 0; background: currentColor; opacity: 0.6;
  border-radius: 2px; }
.mark.dot { width: 0.6rem; height: 0.6rem; border: 0; border-radius: 50%;
  background: currentColor; }
.mark.ring { width: 0.7rem; height: 0.7rem; border: 2px solid; border-radius: 50%; }
.mark.tick { width: 0; height: 0.8rem; border: 0; border-left: 3px solid; margin: 0 0.3rem; }
.mark.cross { width: auto; height: auto; border: 0; font-weight: 700; line-height: 1; }
.mark.cross::before { content: "+"; }
.numbers { color: var(--soft); font-size: 0.83rem; margin: 0.55rem 0 0;
  font-variant-numeric: tabular-nums; overflow-wrap: anywhere; }
figure .what { margin-top: auto; }
details { font-size: 0.9rem; }
details.what { padding-top: 0.5rem; font-size: 0.83rem; color: var(--soft); }
details.what p { margin: 0.4rem 0 0; }
details b { color: var(--ink); font-weight: 600; }
summary { cursor: pointer; color: var(--soft); width: fit-content; }
summary:hover { color: var(--ink); }
details.more { margin: 0.8rem 0; }
.scroll { overflow-x: auto; background: var(--card); border: 1px solid var(--rule);
  border-radius: 0.6rem; margin: 0.8rem 0; }
.narrow { max-width: 34rem; }
table { border-collapse: collapse; width: 100%; font-size: 0.87rem;
  font-variant-numeric: tabular-nums; }
th, td { padding: 0.4rem 0.75rem; text-align: right; white-space: nowrap;
  border-bottom: 1px solid var(--rule); }
th { color: var(--soft); font-weight: 500; }
tbody tr:last-child td { border-bottom: 0; }
th.word, td.word { text-align: left; }
.facts table { table-layout: fixed; }
.facts td { white-space: normal; text-align: left; vertical-align: top; }
.facts td { overflow-wrap: break-word; }
.facts td.word { color: var(--soft); width: 12rem; }
pre { background: var(--card); border: 1px solid var(--rule); border-radius: 0.6rem;
  margin: 0.6rem 0; padding: 0.8rem 1rem; overflow-x: auto;
  font: 0.82rem/1.5 ui-monospace, Menlo, Consolas, monospace; }
dl { display: grid; grid-template-columns: minmax(8rem, 13rem) 1fr; gap: 0.7rem 1.5rem;
  font-size: 0.92rem; max-width: 62rem; }
dt { font-weight: 600; } dd { margin: 0; color: var(--soft); }
dt:target, dt:target + dd { color: var(--blue); }
footer { color: var(--soft); font-size: 0.85rem; margin-top: 3rem; padding-bottom: 2.5rem; }
@media (max-width: 36rem) {
  dl { grid-template-columns: 1fr; gap: 0.2rem; } dd { margin-bottom: 0.7rem; }
  .tiles { grid-template-columns: 1fr 1fr; gap: 0.6rem; } .tile { padding: 0.6rem 0.7rem; }
  .tile b { font-size: 1.2rem; } .facts td.word { width: 7.5rem; }
  figure { padding: 0.8rem 0.75rem; }
}
@media print { .grid { grid-template-columns: 1fr 1fr; } figure, .tile { break-inside: avoid; } }
"""
)
"""Nothing in it names another file."""
