// Values that are known by stretches of a time that begins at 0.
export function valueAt(values: number[], at: number, seconds: number): number | null {
  if (!values.length || !(seconds > 0)) return null;
  return values[Math.min(Math.max(Math.floor((at / seconds) * values.length), 0), values.length - 1)];
}
