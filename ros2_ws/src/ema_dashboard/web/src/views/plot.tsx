// SPDX-License-Identifier: Apache-2.0
// uPlot in the page's colours. A label describes each plot for screen readers.

import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import { significant } from "../format.ts";
import { useBox, useTheme } from "./hooks.ts";

export type Colour = (name: string) => string;

export interface PlotProps {
  label: string; // description for screen readers
  height: number;
  x: string; // quantity and unit
  y: string;
  series: uPlot.Series[]; // without x
  data: uPlot.AlignedData;
  bands?: uPlot.Band[];
  isTime?: boolean;
  yRange?: uPlot.Range.Function;
  xRange?: uPlot.Range.Function;
  draw?: (plot: uPlot, colour: Colour) => void;
  sync?: string;
  legend?: boolean;
  onPlot?: (plot: uPlot | null, isSeen: () => boolean) => void;
}

/** A colour of the style sheet in the current theme. */
export const colour: Colour = (name) =>
  getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

const FONT = '13px system-ui, -apple-system, "Segoe UI", Roboto, sans-serif';

export function Plot(props: PlotProps) {
  const [ref, width, isSeen] = useBox<HTMLDivElement>();
  const theme = useTheme();
  const plot = useRef<uPlot | null>(null);
  const latest = useRef(props);
  latest.current = props;
  const structure = props.series.map((item) => `${item.label}${item.stroke}${item.fill}`).join("|");

  useEffect(() => {
    if (!width) return;
    plot.current = new uPlot(options(latest, width), latest.current.data, ref.current!);
    latest.current.onPlot?.(plot.current, isSeen);
    return () => {
      latest.current.onPlot?.(null, isSeen);
      plot.current?.destroy();
      plot.current = null;
    };
  }, [width > 0, theme, structure, props.isTime, props.y, props.x]);

  useEffect(() => {
    if (plot.current && plot.current.width !== width) {
      plot.current.setSize({ width, height: latest.current.height });
    }
  }, [width]);

  useEffect(() => {
    plot.current?.setData(props.data);
  }, [props.data]);

  return (
    <div class="plot" ref={ref} role="img" aria-label={props.label}
      style={{ minHeight: `${props.height}px` }} />
  );
}

const DATE = "\n{YYYY}-{MM}-{DD}";
const DAY_S = 86_400;

/** Tick labels by smallest tick distance [s]; the second label is added at the start of a day. */
const TIMES: uPlot.Axis.Values = [
  [365 * DAY_S, "{YYYY}", null, null, null, null, null, null, 1],
  [28 * DAY_S, "{YYYY}-{MM}", null, null, null, null, null, null, 1],
  [DAY_S, "{MM}-{DD}", "\n{YYYY}", null, null, null, null, null, 1],
  [60, "{HH}:{mm}", DATE, DATE, DATE, null, null, null, 1],
  [1, "{HH}:{mm}:{ss}", DATE, DATE, DATE, null, null, null, 1],
];

function options(latest: { current: PlotProps }, width: number): uPlot.Options {
  const { x, y, series, bands, isTime, yRange, xRange, sync, legend, height } = latest.current;
  const axis = {
    stroke: colour("ink-soft"),
    grid: { stroke: colour("grid"), width: 1 },
    ticks: { stroke: colour("grid"), width: 1, size: 5 },
    font: FONT,
    labelFont: FONT,
  };
  return {
    width,
    height,
    pxAlign: 1,
    padding: [8, 18, 0, 0],
    scales: {
      x: { time: isTime ?? false, ...(xRange ? { range: xRange } : {}) },
      y: yRange ? { range: yRange } : {},
    },
    axes: [
      {
        ...axis, label: x, labelSize: 20, size: isTime ? 46 : 30, // times have their date below
        ...(isTime ? { values: TIMES, space: 64 } : {}),
      },
      { ...axis, label: y, labelSize: 20, size: 52 },
    ],
    legend: { show: legend ?? true, live: true },
    cursor: {
      y: false,
      points: { size: 6 },
      drag: { x: true, y: false },
      ...(sync ? { sync: { key: sync } } : {}),
    },
    series: [{ label: "at", value: (_, value) => (value === null ? "" : significant(value, 4)) }, ...series.map((item) => resolved(item))],
    ...(bands ? { bands: bands.map((band) => ({ ...band, fill: colour(String(band.fill)) })) } : {}),
    hooks: { draw: [(plot) => latest.current.draw?.(plot, colour)] },
  };
}

/** A series with colour names replaced by the colours of the theme. */
function resolved(series: uPlot.Series): uPlot.Series {
  return {
    ...series,
    ...(series.stroke ? { stroke: colour(String(series.stroke)) } : {}),
    ...(series.points?.fill
      ? { points: { ...series.points, fill: colour(String(series.points.fill)) } } : {}),
  };
}

/** Draw a dashed horizontal line with a text, for limits. */
export function line(plot: uPlot, value: number, text: string, stroke: string): void {
  const y = plot.valToPos(value, "y", true);
  const { left, top, width, height } = plot.bbox;
  if (!(y >= top - 1 && y <= top + height + 1)) return;
  const { ctx } = plot;
  const ratio = devicePixelRatio;
  ctx.save();
  ctx.strokeStyle = stroke;
  ctx.fillStyle = stroke;
  ctx.lineWidth = 2 * ratio;
  ctx.setLineDash([8 * ratio, 5 * ratio]);
  ctx.beginPath();
  ctx.moveTo(left, y);
  ctx.lineTo(left + width, y);
  ctx.stroke();
  ctx.font = `600 ${12 * ratio}px system-ui, sans-serif`;
  ctx.textAlign = "left";
  const isHigh = y - top < 18 * ratio;
  ctx.textBaseline = isHigh ? "top" : "bottom";
  ctx.fillText(text, left + 6 * ratio, y + (isHigh ? 4 : -4) * ratio);
  ctx.restore();
}

/** Draw a vertical line with a text, for the present. */
export function upright(plot: uPlot, value: number, text: string, stroke: string): void {
  const x = plot.valToPos(value, "x", true);
  const { left, top, width, height } = plot.bbox;
  if (!(x >= left && x <= left + width)) return;
  const { ctx } = plot;
  const ratio = devicePixelRatio;
  ctx.save();
  ctx.strokeStyle = stroke;
  ctx.fillStyle = stroke;
  ctx.lineWidth = ratio;
  ctx.setLineDash([2 * ratio, 3 * ratio]);
  ctx.beginPath();
  ctx.moveTo(x, top);
  ctx.lineTo(x, top + height);
  ctx.stroke();
  ctx.font = `${12 * ratio}px system-ui, sans-serif`;
  const isRight = x > left + 0.8 * width;
  ctx.textAlign = isRight ? "right" : "left";
  ctx.textBaseline = "top";
  ctx.fillText(text, x + (isRight ? -4 : 4) * ratio, top + 2 * ratio);
  ctx.restore();
}

/** Draw a bar from low to high at each x, for intervals. */
export function intervals(
  plot: uPlot, x: ArrayLike<number>, low: ArrayLike<number>, high: ArrayLike<number>,
  stroke: string,
): void {
  const { ctx } = plot;
  const { left, top, width, height } = plot.bbox;
  ctx.save();
  ctx.beginPath();
  ctx.rect(left, top, width, height);
  ctx.clip();
  ctx.strokeStyle = stroke;
  ctx.lineWidth = devicePixelRatio;
  ctx.beginPath();
  for (let i = 0; i < x.length; i++) {
    if (!Number.isFinite(low[i]!) || !Number.isFinite(high[i]!)) continue;
    const at = plot.valToPos(x[i]!, "x", true);
    if (at < left || at > left + width) continue;
    ctx.moveTo(at, plot.valToPos(low[i]!, "y", true));
    ctx.lineTo(at, plot.valToPos(high[i]!, "y", true));
  }
  ctx.stroke();
  ctx.restore();
}
