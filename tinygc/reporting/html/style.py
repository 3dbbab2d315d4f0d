"""The page's style sheet: light, dark and paper; colours are variables, and every drawing takes them from here."""

#: of each kind of line or dot: its colour on white and on black.  Contrast with the page at least 4.5 for what carries words.
COLOURS = {
    "x": ("#b8442a", "#f08a6b"),
    "y": ("#1a7656", "#5fc9a0"),
    "z": ("#3358b8", "#8aa9f5"),
    "raw": ("#8a6d3b", "#cfae74"),
    "raw_bias_removed": ("#5b7a1f", "#a9c76a"),
    "least_squares": ("#1f5fbf", "#79adf7"),
    "pso": ("#6f4fc4", "#b39df2"),
    "tinygc": ("#0b7a75", "#5cc7c1"),
    "tinygc_denoised": ("#a83a78", "#ee92c4"),
    "physics": ("#b03a55", "#f58fa5"),
    "tinygc_physics": ("#3f6f8f", "#86b7d8"),
    "before": ("#8a6d3b", "#cfae74"),
    "after": ("#1f5fbf", "#79adf7"),
    "floor": ("#5d6670", "#98a1ac"),
    "limit": ("#a3341f", "#f2937d"),
    "good": ("#1a7656", "#5fc9a0"),
    "bad": ("#b3261e", "#ff8a80"),
    "still": ("#1a7656", "#5fc9a0"),
    "turn": ("#1f5fbf", "#79adf7"),
    "quiet": ("#7c848d", "#828b95"),
    "ink": ("#1c2126", "#e7eaee"),
}
PAGE = {
    "ink": ("#1c2126", "#e7eaee"),
    "soft": ("#59626c", "#a3acb7"),
    "rule": ("#dfe3e8", "#31373f"),
    "grid": ("#e9ecf0", "#282e35"),
    "page": ("#ffffff", "#14171b"),
    "panel": ("#f6f7f9", "#1b1f25"),
    "code": ("#f4f5f7", "#1b1f25"),
}

_RULES = """
*{box-sizing:border-box}
html{color-scheme:light dark;-webkit-text-size-adjust:100%;scroll-behavior:smooth}
body{margin:0;background:var(--page);color:var(--ink);font:15.5px/1.6 Inter,"Helvetica Neue","Segoe UI",Roboto,Arial,sans-serif;
 font-feature-settings:"tnum","cv05","ss03";font-variant-numeric:tabular-nums}
.sheet{display:grid;grid-template-columns:11.5rem minmax(0,860px);column-gap:3.5rem;justify-content:center;padding:0 1.5rem 5rem}
nav{position:sticky;top:0;align-self:start;padding:4.2rem 0 2rem;font-size:13.5px;line-height:1.35}
nav ol{list-style:none;margin:0;padding:0}
nav li{margin:0 0 .62rem}
nav a{color:var(--soft);text-decoration:none}
nav a:hover,nav a:focus{color:var(--ink);text-decoration:underline}
main{min-width:0;padding-top:3.6rem}
header p{margin:0}
.kicker{color:var(--soft);font-size:13.5px}
h1{font-size:2.05rem;line-height:1.15;letter-spacing:-.022em;font-weight:650;margin:.25rem 0 .5rem;overflow-wrap:anywhere}
h2{font-size:1.32rem;line-height:1.25;letter-spacing:-.014em;font-weight:640;margin:0 0 .9rem}
h3{font-size:1rem;font-weight:640;margin:2.1rem 0 .5rem}
section{margin-top:3.4rem;padding-top:1.7rem;border-top:1px solid var(--rule)}
p,li{max-width:44.5rem}
p{margin:.7rem 0}
.soft,figcaption,.caption{color:var(--soft)}
a{color:var(--k-least_squares)}
strong{font-weight:640}
.unseen{position:absolute;width:1px;height:1px;overflow:hidden;clip-path:inset(50%);white-space:nowrap}
.answer{margin-top:2rem;border:1px solid var(--rule);border-radius:10px;background:var(--panel);padding:1.5rem 1.6rem 1.2rem}
.verdict{display:flex;flex-wrap:wrap;align-items:center;gap:.5rem .9rem;margin:0 0 1.2rem}
.stamp{display:inline-flex;align-items:center;gap:.5rem;font-weight:660;font-size:1.02rem;padding:.22rem .8rem .22rem .65rem;
 border-radius:99px;border:1.5px solid currentColor;white-space:nowrap}
.stamp svg{width:1.05em;height:1.05em;display:block}
.verdict p{margin:0;font-size:14px;color:var(--soft)}
.heads{display:grid;grid-template-columns:repeat(auto-fit,minmax(14.5rem,1fr));gap:1.1rem 2rem;margin:0}
.heads.four{grid-template-columns:repeat(auto-fit,minmax(min(100%,19rem),1fr))}
.heads dt{color:var(--soft);font-size:13.5px;margin:0}
.heads dd{margin:.05rem 0 0;font-size:2rem;line-height:1.2;letter-spacing:-.025em;font-weight:640;white-space:nowrap}
.heads dd small{font-size:.62em;font-weight:500;color:var(--soft);letter-spacing:-.01em}
.heads dd+dd{font-size:13.5px;line-height:1.45;font-weight:400;letter-spacing:0;color:var(--soft);white-space:normal}
.reasons{list-style:none;margin:1.1rem 0 0;padding:.9rem 0 0;border-top:1px solid var(--rule);font-size:14px}
.reasons li{display:flex;gap:.55rem;align-items:baseline;margin:.15rem 0;max-width:none}
.reasons b{font-weight:700;flex:none}
figure{margin:1.5rem 0 1.9rem}
figcaption{font-size:13.5px;line-height:1.5;margin-top:.35rem;max-width:44.5rem}
figure svg,figure img{display:block;width:100%;height:auto}
.narrow{display:none}
.keys{display:flex;flex-wrap:wrap;gap:.15rem 1.15rem;font-size:13px;color:var(--soft);margin:0 0 .5rem}
.key{display:inline-flex;align-items:center;gap:.42rem;color:inherit}
.key i{flex:none;color:var(--c)}
.key .dot{width:8px;height:8px;border-radius:50%;background:currentColor}
.key .ring{width:8px;height:8px;border-radius:50%;border:1.6px solid currentColor}
.key .line{width:16px;border-top:2px solid currentColor}
.key .dash{width:16px;border-top:2px dashed currentColor}
.key .block{width:13px;height:10px;border-radius:2px;background:currentColor;opacity:.35}
svg text{font-family:inherit;fill:var(--soft);font-size:12px}
svg .word{fill:var(--c,var(--soft));paint-order:stroke;stroke:var(--halo,var(--page));stroke-width:3.5px;stroke-linejoin:round}
.answer{--halo:var(--panel)}
svg .strong{font-weight:640;fill:var(--ink)}
svg .grid{stroke:var(--grid);fill:none}
svg .axis{stroke:var(--rule);fill:none}
svg .line{stroke:var(--c);fill:none;stroke-width:1.7;stroke-linejoin:round;stroke-linecap:round}
svg .thin{stroke:var(--c);fill:none;stroke-width:1;stroke-linejoin:round;opacity:.75}
svg .dash{stroke:var(--c);fill:none;stroke-width:1.3;stroke-dasharray:5 4}
svg .area{fill:var(--c);opacity:.2}
svg .block{fill:var(--c);opacity:.22}
svg .solid{fill:var(--c)}
svg .dot{fill:var(--c)}
svg .faint{fill:var(--c);opacity:.28}
svg .ring{fill:var(--page);stroke:var(--c);stroke-width:1.6}
.scroll{overflow-x:auto;margin:1.1rem 0 1.4rem}
table{border-collapse:collapse;width:100%;font-size:14px;line-height:1.4}
.caption{font-size:13.5px;margin:1.2rem 0 -.6rem}
th,td{padding:.42rem 0 .42rem 1.3rem;text-align:right;border-bottom:1px solid var(--rule);vertical-align:baseline;font-weight:400;
 white-space:nowrap}
th:first-child{text-align:left;padding-left:0;white-space:normal}
thead th{color:var(--soft);font-size:13px;border-bottom-color:var(--soft)}
tr.marked th,tr.marked td{font-weight:640}
td small,th small{color:var(--soft);font-size:12.5px;font-weight:400}
.words td:first-child,.words td{text-align:left;white-space:normal;overflow-wrap:anywhere}
.words th{text-align:left}
.parameters td{min-width:8.2rem}
.parameters td .of{display:block;color:var(--soft);font-size:12px}
.parameters .unit{color:var(--soft);font-size:12.5px}
.parameters .absent{color:var(--soft);white-space:normal;font-size:13px}
.facts{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,9.4rem),1fr));gap:.9rem 1.6rem;margin:1.1rem 0 1.5rem}
.facts dt{color:var(--soft);font-size:13px}
.facts dd{margin:0;font-weight:560;overflow-wrap:anywhere}
pre{background:var(--code);border:1px solid var(--rule);border-radius:8px;padding:.85rem 1rem;overflow-x:auto;margin:.7rem 0 1.3rem;
 font:12.8px/1.55 ui-monospace,"SF Mono",Menlo,Consolas,"DejaVu Sans Mono",monospace;font-feature-settings:normal}
code{font:.88em ui-monospace,"SF Mono",Menlo,Consolas,"DejaVu Sans Mono",monospace;font-feature-settings:normal;overflow-wrap:anywhere}
pre code{font:inherit;overflow-wrap:normal}
.formula{font-size:1.25rem;letter-spacing:-.01em;margin:1rem 0}
.hash{font:12px/1.5 ui-monospace,"SF Mono",Menlo,Consolas,"DejaVu Sans Mono",monospace;overflow-wrap:anywhere;white-space:normal}
.pair{display:grid;grid-template-columns:repeat(auto-fit,minmax(19rem,1fr));gap:0 2.5rem;align-items:start}
.found{border-left:3px solid var(--k-physics);padding:.1rem 0 .1rem 1.1rem;margin:1.2rem 0}
.found p{margin:.25rem 0}
.found h3{margin:.1rem 0 .2rem;overflow-wrap:anywhere}
.warning{border-left:3px solid var(--k-raw);padding:.1rem 0 .1rem 1.1rem;margin:1.1rem 0;max-width:44.5rem}
.download{display:inline-block;border:1px solid var(--rule);border-radius:7px;padding:.32rem .85rem;text-decoration:none;
 font-size:14px;margin:.2rem .6rem .2rem 0}
.download:hover{background:var(--panel)}
footer{margin-top:3.5rem;padding-top:1.2rem;border-top:1px solid var(--rule);color:var(--soft);font-size:13px}
:focus-visible{outline:2px solid var(--k-least_squares);outline-offset:2px}
@media (max-width:1080px){.sheet{display:block;max-width:908px;margin:0 auto}nav{display:none}}
@media (max-width:640px){
 body{font-size:15px}
 .sheet{padding:0 1.1rem 3rem}
 main{padding-top:1.8rem}
 h1{font-size:1.6rem}
 section{margin-top:2.4rem;padding-top:1.3rem}
 .wide{display:none}.narrow{display:block}
 .answer{padding:1.1rem 1.1rem .9rem}
 .heads dd{font-size:1.65rem}
 table{font-size:13.2px}
 .minor{display:none}
 th,td{padding-left:.75rem}
 .parameters thead{display:none}
 .parameters tr{display:grid;grid-template-columns:repeat(3,minmax(0,1fr));border-bottom:1px solid var(--rule);padding:.5rem 0}
 .parameters th{grid-column:1/-1;border:0;padding:0 0 .2rem}
 .parameters td{border:0;padding:0;min-width:0;text-align:left;white-space:normal}
 .parameters td small{display:block}
 .parameters td:not(:has(.of))::before{content:attr(data-of);display:block;color:var(--soft);font-size:12px}
 .stack thead{display:none}
 .stack tr{display:block;border-bottom:1px solid var(--rule);padding:.5rem 0}
 .stack th,.stack td{display:block;border:0;padding:0;text-align:left}
}
@media print{
 @page{size:A4;margin:16mm 15mm}
 html{color-scheme:light}
 body{font-size:9.6pt;line-height:1.42;background:none}
 h1{font-size:20pt}
 h2{font-size:13pt}
 table{font-size:8.4pt}
 pre{font-size:7.6pt}
 svg text{font-size:13.5px}
 .heads{grid-template-columns:repeat(3,1fr)}
 .heads dd{font-size:16pt}
 .heads dd+dd,.reasons,figcaption,.caption,.keys,.kicker{font-size:8.4pt}
 .answer{margin-top:1rem;padding:1rem 1.2rem .7rem}
 .pair{grid-template-columns:1fr 1fr}
 nav,.download{display:none}
 .sheet{display:block;padding:0}
 main{padding-top:0}
 section{margin-top:1.2rem;padding-top:.8rem}
 footer{margin-top:1rem;padding-top:.5rem;break-before:avoid}
 h2,h3{break-after:avoid}
 figure,.answer,.found,tr,.facts>div{break-inside:avoid}
 figure{margin:.8rem 0 1rem}
 .scroll{overflow:visible}
 pre{white-space:pre-wrap;overflow-wrap:anywhere;break-inside:avoid}
 .wide{display:block}.narrow{display:none}
 a{color:inherit;text-decoration:none}
}
"""


def style_sheet() -> str:
    """All of it, as CSS."""
    light, dark = (_variables(shade) for shade in (0, 1))
    kinds = "".join(f".k-{name}{{--c:var(--k-{name})}}" for name in COLOURS)
    return f":root{{{light}}}@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}{kinds}{_RULES}"


def _variables(shade: int) -> str:
    return "".join(
        [
            *(f"--{name}:{colours[shade]};" for name, colours in PAGE.items()),
            *(f"--k-{name}:{colours[shade]};" for name, colours in COLOURS.items()),
        ]
    )
