"""How the report's page looks: on a wide screen, on a phone, in the dark and in print."""

STYLE = """
:root { --ink: #1b1b1b; --soft: #555; --paper: #fff; --ground: #f4f5f7; --line: #d5d8dc;
        --good: #005a3c; --good-ground: #e2f3ec; --bad: #8a2b00; --bad-ground: #fbe9df;
        --note: #5c4300; --note-ground: #fdf3d7; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 82rem; padding: 1rem; color: var(--ink);
       background: var(--ground); font: 16px/1.5 system-ui, "Liberation Sans", Arial, sans-serif; }
h1 { font-size: 1.5rem; margin: .2rem 0; line-height: 1.25; }
h2 { font-size: 1.15rem; margin: 2rem 0 .6rem; border-bottom: 1px solid var(--line); }
p, ul { margin: .4rem 0; max-width: 60rem; }
.verdict, .note { border-radius: .5rem; padding: .9rem 1.1rem; border-left: .6rem solid; }
.good { color: var(--good); background: var(--good-ground); border-color: var(--good); }
.bad { color: var(--bad); background: var(--bad-ground); border-color: var(--bad); }
.note { color: var(--note); background: var(--note-ground); border-color: var(--note);
        margin: 1rem 0; }
.verdict p { color: var(--ink); }
.grid { columns: 2 28rem; column-gap: 1rem; }
figure { margin: 0 0 1rem; padding: .7rem; background: var(--paper); border: 1px solid var(--line);
         border-radius: .5rem; break-inside: avoid; }
figure svg { display: block; width: 100%; height: auto; }
figcaption { color: #444; font-size: .9rem; }
figcaption b { color: #1b1b1b; }
.scroll { overflow-x: auto; background: var(--paper); border: 1px solid var(--line);
          border-radius: .5rem; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums;
        width: 100%; color: #1b1b1b; }
th, td { padding: .25rem .6rem; text-align: right; white-space: nowrap;
         border-bottom: 1px solid #e6e8eb; }
th { text-align: right; vertical-align: bottom; font-weight: 600; background: #eceff2; }
th small { font-weight: 400; color: #555; display: block; }
td.text, th.text { text-align: left; white-space: normal; min-width: 9rem; }
td.code { font-family: ui-monospace, "Liberation Mono", monospace; text-align: left;
          white-space: normal; overflow-wrap: anywhere; }
details > summary { cursor: pointer; margin: .5rem 0; }
footer { color: var(--soft); font-size: .85rem; margin-top: 2rem; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e8e8e8; --soft: #aaa; --paper: #fff; --ground: #16181b; --line: #3a3f45;
          --good: #7fd6b1; --good-ground: #10291f; --bad: #ffb28f; --bad-ground: #331a0f;
          --note: #f0d48a; --note-ground: #2e2610; } }
@media print {
  :root { --ink: #000; --ground: #fff; --line: #bbb; --good: #005a3c; --good-ground: #fff;
          --bad: #8a2b00; --bad-ground: #fff; --note: #5c4300; --note-ground: #fff; }
  body { max-width: none; padding: 0; font-size: 10pt; }
  .grid { columns: 1; } figure { margin: 0 0 5mm; border: 0; padding: 0; }
  figure svg { max-width: 150mm; margin: 0 auto; }
  .scroll { overflow: visible; border: 0; } table { font-size: 7.5pt; }
  th, td { padding: .1rem .25rem; } tr { break-inside: avoid; }
  thead { display: table-header-group; }
  h2 { break-after: avoid; } }
"""
