"""How the report looks, on a screen and on paper: one sheet, no script, nothing from outside."""

SCREEN = """
:root { color-scheme: light; --ink: #1a1a1a; --soft: #555; --line: #dedede; --key: #0072b2; }
* { box-sizing: border-box; }
body { font: 16px/1.55 system-ui, "DejaVu Sans", sans-serif; color: var(--ink); background: #fff;
       max-width: 60rem; margin: 0 auto; padding: 2.2rem 1.25rem 4rem; }
h1 { font-size: 1.6rem; line-height: 1.25; margin: 0 0 .3rem; }
h2 { font-size: 1.2rem; margin: 2.6rem 0 .7rem; padding-bottom: .2rem;
     border-bottom: 1px solid var(--line); }
p, li { max-width: 47rem; }
.about, figcaption, .note { color: var(--soft); font-size: .9rem; }
.verdict { border-left: 5px solid var(--key); background: #f1f7fb; padding: .8rem 1.1rem;
           margin: 1.4rem 0; }
.verdict p { margin: .4rem 0; }
.verdict .headline { font-weight: 650; font-size: 1.2rem; line-height: 1.4; }
.equations { margin: 1rem 0; padding: .6rem 1rem; background: #fafafa;
             border: 1px solid var(--line); }
.eq { font: 1.02rem/1.9 "DejaVu Serif", Georgia, serif; overflow-wrap: anywhere;
      padding-left: 2.2rem; text-indent: -2.2rem; }
.eq.let { color: var(--soft); font-size: .92rem; }
mark { background: #ffe3a3; color: inherit; padding: .1rem .3rem; border-radius: 3px;
       font-weight: 600; display: inline-block; max-width: 100%; text-indent: 0;
       line-height: 1.45; }
.scroll { overflow-x: auto; margin: .6rem 0; }
table { border-collapse: collapse; font-size: .93rem; font-variant-numeric: tabular-nums; }
th, td { padding: .4rem .9rem .4rem 0; text-align: left; vertical-align: top; }
th { font-weight: 600; color: var(--soft); border-bottom: 1px solid var(--ink); }
td { border-bottom: 1px solid var(--line); overflow-wrap: break-word; }
td.n, th.n { text-align: right; } td.n { white-space: nowrap; }
.facts td { overflow-wrap: anywhere; }
.facts td:first-child { white-space: nowrap; padding-right: 1.6rem; }
h3 { font-size: 1.02rem; margin: 1.6rem 0 .4rem; }
details { margin-top: 2.4rem; color: var(--soft); }
figure { margin: 1.5rem 0; } figcaption { margin-bottom: .3rem; }
img { max-width: 100%; height: auto; display: block; }
pre { white-space: pre-wrap; overflow-wrap: anywhere; font: .82rem/1.45 ui-monospace, monospace; }
"""
PAPER = """
@page { size: A4; margin: 16mm 15mm; }
@media print {
  * { -webkit-print-color-adjust: exact; print-color-adjust: exact; }
  body { font-size: 10.5pt; max-width: none; padding: 0; }
  h1 { font-size: 17pt; } h2 { font-size: 13pt; margin-top: 1.5rem; break-after: avoid; }
  p, li { max-width: none; orphans: 3; widows: 3; }
  .scroll { overflow: visible; } table { font-size: 9pt; width: 100%; }
  tr, table, figure, .verdict, .equations, .eq { break-inside: avoid; }
  thead { display: table-header-group; }
  h3, figcaption, .note { break-after: avoid; } details { display: none; }
  img { max-height: 210mm; width: auto; max-width: 100%; }
  pre { font-size: 8.5pt; }
}
"""
