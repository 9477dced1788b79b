// SPDX-License-Identifier: Apache-2.0
// Numbers with the digits that their uncertainty leaves, times and durations, in words.

const NONE = "–";
const MINUS = "−";

/** A number with a fixed count of decimals and a true minus sign. */
export function fixed(value: number, decimals: number): string {
  if (!Number.isFinite(value)) return NONE;
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
}

/** Decimals of a value whose standard deviation is sigma: sigma keeps two digits below 3. */
export function decimalsOf(sigma: number): number {
  const exponent = Math.floor(Math.log10(sigma));
  const leading = sigma / 10 ** exponent;
  return Math.min(Math.max((leading < 2.95 ? 1 : 0) - exponent, 0), 9);
}

/** Value and standard deviation, both with the digits that the latter leaves. */
export function withSigma(value: number, sigma: number): string {
  if (!Number.isFinite(value)) return NONE;
  if (!(sigma > 0) || !Number.isFinite(sigma)) return significant(value, 3);
  const decimals = decimalsOf(sigma);
  return `${fixed(value, decimals)} ± ${fixed(sigma, decimals)}`;
}

/** A number with so many significant digits, and no exponent in the range of our quantities. */
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

/** Whole hours, with a decimal below ten. */
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
 * Hours of a life, rounded to what its interval leaves: two digits of a quarter of its width,
 * which is about its standard deviation.
 */
export function lifeHours(value: number, life: Life): string {
  const width = (life.hours_95 - life.hours_05) / 3.29;
  if (!Number.isFinite(width) || !Number.isFinite(value) || width < 20) return hours(value);
  const step = 10 ** (Math.floor(Math.log10(width)) - 1);
  return hours(Math.round(value / step) * step);
}

/** How long ago, or how long, in the two largest units. */
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

/** A unit as it is put behind a number; "1" and "-" stand for none. */
export function unit(name: string): string {
  return name === "1" || name === "-" || name === "" ? "" : ` ${name}`;
}

// Requirements in rad are read in mrad, as on the command line.
const SHOWN_IN: Record<string, [string, number]> = { rad: ["mrad", 1e3] };

export function shownUnit(name: string): [string, number] {
  return SHOWN_IN[name] ?? [name, 1];
}
