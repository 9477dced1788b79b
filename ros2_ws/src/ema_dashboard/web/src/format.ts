// SPDX-License-Identifier: Apache-2.0
// Formatting of numbers, rounded to their uncertainty, and of times and durations.

const NONE = "–";
const MINUS = "−";

/** A number with a fixed number of decimals and a true minus sign. */
export function fixed(value: number, decimals: number): string {
  if (!Number.isFinite(value)) return NONE;
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
}

/** Decimals of a value with standard deviation sigma; sigma has two digits if the first is 1 or 2, else one. */
export function decimalsOf(sigma: number): number {
  const exponent = Math.floor(Math.log10(sigma));
  const leading = sigma / 10 ** exponent;
  return Math.min(Math.max((leading < 2.95 ? 1 : 0) - exponent, 0), 9);
}

/** Value and standard deviation, both rounded to the precision of the standard deviation. */
export function withSigma(value: number, sigma: number): string {
  if (!Number.isFinite(value)) return NONE;
  if (!(sigma > 0) || !Number.isFinite(sigma)) return significant(value, 3);
  const decimals = decimalsOf(sigma);
  return `${fixed(value, decimals)} ± ${fixed(sigma, decimals)}`;
}

/** A number with `digits` significant digits; an exponent is used only below 1e-5 and from 1e7. */
export function significant(value: number, digits: number): string {
  if (!Number.isFinite(value)) return NONE;
  if (value === 0) return "0";
  const exponent = Math.floor(Math.log10(Math.abs(value)));
  if (exponent < -5 || exponent > 6) {
    return value.toExponential(digits - 1).replaceAll("-", MINUS);
  }
  return fixed(value, Math.max(digits - 1 - exponent, 0));
}

const grouped = new Intl.NumberFormat("en-GB", { maximumFractionDigits: 0 });

/** Whole hours; one decimal below ten. */
export function hours(value: number): string {
  if (value === Infinity) return "∞";
  if (!Number.isFinite(value)) return NONE;
  if (Math.abs(value) < 9.95) return fixed(value, 1);
  return (value < 0 ? MINUS : "") + grouped.format(Math.abs(value));
}

export interface Life {
  hours_05: number;
  hours_50: number;
  hours_95: number;
}

/**
  * Hours of a remaining life, rounded to two digits of its standard deviation, which is estimated from
  * its 90 % interval.
 */
export function lifeHours(value: number, life: Life): string {
  const width = (life.hours_95 - life.hours_05) / 3.29;
  if (!Number.isFinite(width) || !Number.isFinite(value) || width < 20) return hours(value);
  const step = 10 ** (Math.floor(Math.log10(width)) - 1);
  return hours(Math.round(value / step) * step);
}

/** A duration in its two largest units. */
export function duration(s: number): string {
  if (!Number.isFinite(s)) return NONE;
  const whole = Math.max(Math.round(s), 0);
  if (whole < 60) return `${whole} s`;
  const minutes = Math.floor(whole / 60);
  if (minutes < 10) return `${minutes} min ${whole % 60} s`;
  if (minutes < 60) return `${minutes} min`;
  const h = Math.floor(minutes / 60);
  if (h < 24) return `${h} h ${minutes % 60} min`;
  return `${Math.floor(h / 24)} d ${h % 24} h`;
}

const two = (value: number) => String(value).padStart(2, "0");

/** Local date and time. */
export function dateTime(s: number): string {
  const at = new Date(s * 1000);
  const date = `${at.getFullYear()}-${two(at.getMonth() + 1)}-${two(at.getDate())}`;
  return `${date} ${clockTime(s)}`;
}

export function clockTime(s: number): string {
  const at = new Date(s * 1000);
  return `${two(at.getHours())}:${two(at.getMinutes())}:${two(at.getSeconds())}`;
}

export function percent(share: number, digits = share < 0.1 ? 2 : 3): string {
  return Number.isFinite(share) ? `${significant(100 * share, digits)} %` : NONE;
}

/** A unit as appended to a number; "" for a dimensionless quantity ("1" or "-"). */
export function unit(name: string): string {
  return name === "1" || name === "-" || name === "" ? "" : ` ${name}`;
}

// Requirements in rad are shown in mrad, as on the command line.
const SHOWN_IN: Record<string, [string, number]> = { rad: ["mrad", 1e3] };

export function shownUnit(name: string): [string, number] {
  return SHOWN_IN[name] ?? [name, 1];
}
