"""The look of the report."""

CSS = """
:root { --ink: #26303a; --soft: #6b7782; --line: #e2e5e8; --accent: #6d3b6b; }
* { box-sizing: border-box; }
body { font: 15px/1.5 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; color: var(--ink);
  background: #eef0f2; margin: 0 auto; max-width: 1180px; padding: 24px; }
header, section { background: #fff; border-radius: 10px; padding: 20px 26px; margin-bottom: 18px;
  box-shadow: 0 1px 3px rgba(30, 40, 50, .12); }
header { border-top: 5px solid var(--accent); }
h1 { font-size: 26px; margin: 0 0 2px; } h2 { font-size: 18px; margin: 0 0 12px; }
h3 { font-size: 15px; margin: 14px 0 4px; }
.sub, .none, figcaption { color: var(--soft); margin: 0 0 8px; font-size: 13.5px; }
.detail { background: #fbeceb; border-left: 4px solid #c0392b; padding: 8px 12px; white-space: pre-wrap; }
.badge { display: inline-block; border-radius: 10px; padding: 1px 10px; font-size: 12.5px; font-weight: 600;
  color: #fff; background: #7a8590; vertical-align: 2px; }
.badge.succeeded, .badge.deployed, .badge.ok { background: #3f9142; }
.badge.partial, .badge.skipped { background: #dd9a22; }
.badge.failed, .badge.bad { background: #c0392b; } .badge.aborted { background: #8e44ad; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(108px, 1fr)); gap: 10px; margin-top: 14px; }
.tile { background: #f5f6f8; border-radius: 8px; padding: 10px 12px; }
.tile b { display: block; font-size: 19px; font-variant-numeric: tabular-nums; white-space: nowrap; }
.tile span { color: var(--soft); font-size: 12px; line-height: 1.25; display: block; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: 14px; font-variant-numeric: tabular-nums; }
th { text-align: left; color: var(--soft); font-weight: 600; font-size: 12.5px; }
th, td { padding: 6px 12px 6px 0; border-bottom: 1px solid var(--line); vertical-align: top; }
tr:last-child td { border-bottom: 0; }
pre { font-size: 12px; white-space: pre-wrap; margin: 0; }
svg { display: block; width: 100%; height: auto; } .plot svg { max-width: 640px; } svg text { font-family: inherit; }
svg .num { font-size: 11px; fill: #6b7782; } svg .axis { font-size: 12px; fill: #4a5560; font-weight: 600; }
svg .in { font-size: 11px; fill: #fff; } svg .tagged { font-size: 13px; font-weight: 700; fill: #26303a;
  paint-order: stroke; stroke: #f6f4ee; stroke-width: 4px; }
svg .grid { stroke: #e6e8ea; stroke-width: 1; } svg .mark { stroke: #c9a3c7; stroke-width: 1; stroke-dasharray: 3 3; }
svg .line { fill: none; stroke-width: 1.8; stroke-linejoin: round; }
svg .fence { fill: #e3b5a4; fill-opacity: .45; stroke: #c98a72; stroke-width: .8; }
svg .headland { fill: #e4e8d8; } svg .row { fill: none; stroke: #5d7f46; stroke-width: 2.4; }
svg .plant { fill: #5d7f46; } svg .scale { fill: none; stroke: #4a5560; stroke-width: 1.4; }
svg .aim { stroke: #222; stroke-width: 1.4; fill: none; }
.key { margin: 6px 0 0; font-size: 12.5px; color: var(--soft); }
.key span { margin-right: 14px; white-space: nowrap; }
.key i { display: inline-block; width: 10px; height: 10px; border-radius: 2px; margin-right: 5px; }
.pictures { display: grid; grid-template-columns: repeat(auto-fill, minmax(240px, 1fr)); gap: 12px; }
figure { margin: 0; } figure img { width: 100%; border-radius: 6px; display: block; } figcaption { margin: 4px 0 0; }
.servo { border-top: 1px solid var(--line); padding: 8px 0; } .servo:first-of-type { border-top: 0; }
.pair { display: grid; grid-template-columns: 352fr 430fr; gap: 20px; align-items: center; max-width: 900px; }
.stage { position: relative; } .stage svg * { vector-effect: non-scaling-stroke; }
.stage canvas { position: absolute; inset: 0; width: 100%; pointer-events: none; }
#drive-film { display: block; width: 100%; max-width: 640px; margin: 10px auto 0; border-radius: 6px; }
.controls { display: flex; gap: 12px; align-items: center; margin-top: 8px; }
.controls input { flex: 1; } .controls button { width: 38px; }
.controls span { min-width: 190px; font-variant-numeric: tabular-nums; }
.key label { margin-right: 14px; white-space: nowrap; } .key input { margin: 0 5px 0 0; vertical-align: -2px; }
.maps { display: grid; grid-template-columns: 1fr 1fr; gap: 18px; }
@media (max-width: 700px) { .pair { grid-template-columns: 1fr; } body { padding: 8px; } }
@media print { body { background: #fff; } header, section { box-shadow: none; break-inside: avoid; } }
"""
