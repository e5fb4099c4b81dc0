"""How a page looks: one quiet column, a light and a dark scheme, ink on white when printed. No fonts or images from elsewhere."""

__all__ = ["CSS"]

CSS = """
:root {
  color-scheme: light dark;
  --paper: #fff; --ink: #1d2126; --soft: #5c646e; --rule: #d9dde2; --accent: #2f7fc1; --warn: #b4511d;
}
@media (prefers-color-scheme: dark) {
  :root { --paper: #15181c; --ink: #dfe3e8; --soft: #98a1ac; --rule: #343a42; --accent: #5fa5df; --warn: #e58a55; }
}
* { box-sizing: border-box; }
body {
  margin: 0; background: var(--paper); color: var(--ink);
  font: 15px/1.55 system-ui, -apple-system, "Segoe UI", "Helvetica Neue", Arial, sans-serif;
}
main { max-width: 1080px; margin: 0 auto; padding: 40px 28px 64px; }
h1 { font-size: 27px; line-height: 1.25; font-weight: 600; margin: 0 0 4px; letter-spacing: -0.01em; overflow-wrap: anywhere; }
h2 { font-size: 18px; font-weight: 600; margin: 44px 0 10px; padding-top: 14px; border-top: 1px solid var(--rule); }
h3 { font-size: 15px; font-weight: 600; margin: 26px 0 4px; }
h2, h3 { overflow-wrap: anywhere; }
p { max-width: 78ch; margin: 8px 0; }
a { color: var(--accent); text-decoration: none; } a:hover { text-decoration: underline; }
code { font: 0.92em ui-monospace, "SF Mono", Menlo, Consolas, monospace; overflow-wrap: anywhere; }
.sub { color: var(--soft); margin: 0 0 20px; }
.answer { font-size: 17px; line-height: 1.6; max-width: 76ch; }
.answer b { font-weight: 600; white-space: nowrap; }
.odd { border-left: 3px solid var(--warn); padding: 2px 0 2px 14px; margin: 16px 0; max-width: 78ch; }
.odd.none { border-color: var(--rule); color: var(--soft); }
.odd ul { margin: 2px 0; padding-left: 18px; } .odd li { margin: 3px 0; }
nav { margin: 18px 0 0; color: var(--soft); font-size: 14px; } nav a { margin-right: 16px; }
.wide { overflow-x: auto; }
td code { white-space: nowrap; }
table { border-collapse: collapse; font-size: 14px; margin: 8px 0; }
th, td { padding: 5px 22px 5px 0; text-align: left; vertical-align: top; border-bottom: 1px solid var(--rule); }
th { color: var(--soft); font-weight: 500; white-space: nowrap; }
.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
figure { margin: 14px 0 22px; }
figcaption { color: var(--soft); font-size: 13.5px; max-width: 90ch; margin: 2px 0 0 74px; }
.plot { width: 100%; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 3px 22px; font-size: 14px; margin: 8px 0; }
dt { color: var(--soft); } dd { margin: 0; font-variant-numeric: tabular-nums; }
.note { color: var(--soft); font-size: 13.5px; }
ul.notes { padding-left: 20px; max-width: 84ch; } ul.notes li { margin: 3px 0; }
noscript p { color: var(--warn); }
@media (max-width: 720px) { main { padding: 22px 14px; } figcaption { margin-left: 0; } }
@media print {
  :root { --paper: #fff; --ink: #000; --soft: #444; --rule: #ccc; --accent: #000; --warn: #a33f0c; }
  body { font-size: 10pt; } main { max-width: none; padding: 0; } nav { display: none; } .answer { font-size: 11.5pt; }
  h2 { margin-top: 26px; } figure, tr, .odd, dl { break-inside: avoid; } h2, h3 { break-after: avoid; } .wide { overflow: visible; }
  .modebar-container { display: none !important; }
  @page { margin: 16mm 15mm; }
}
"""
