// Numbers as people type them, and as they like to read them. Inside everything is SI.

export const LENGTHS = { mm: 1e-3, cm: 1e-2, m: 1, in: 0.0254 };
export const MASSES = { g: 1e-3, kg: 1 };

/** The number in a field, in SI; null where it is empty; NaN where it is no number. */
export function typed(text, factor = 1) {
  const plain = text.trim().replace(",", ".");
  if (plain === "") return null;
  return rounded(Number(plain) * factor);
}

/** A number for a field, in its unit: as it was typed, without the dust of the division. */
export function shown(value, factor = 1) {
  if (value === null || value === undefined || Number.isNaN(value)) return "";
  return String(rounded(value / factor));
}

/** Twelve digits: no ruler or scale gives more, and 91 * 0.001 is 0.091 again. */
function rounded(value) {
  return Number(value.toPrecision(12));
}

/** Two digits of a number, as `formatting.digits.short` writes them. */
export function short(value) {
  return Math.abs(value) >= 9.95 ? value.toFixed(0) : String(Number(value.toPrecision(2)));
}

export function seconds(value) {
  if (value < 100) return `${value.toFixed(1)} s`;
  return `${Math.floor(value / 60)} min ${Math.round(value % 60)} s`;
}

export function bytes(count) {
  return count < 1e6 ? `${Math.ceil(count / 1e3)} kB` : `${(count / 1e6).toFixed(1)} MB`;
}
