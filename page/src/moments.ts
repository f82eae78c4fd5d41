// Values that are known by stretches of a time that begins at 0.
export function valueAt(values: number[], at: number, seconds: number): number | null {
  if (!values.length || !(seconds > 0)) return null;
  return values[Math.min(Math.max(Math.floor((at / seconds) * values.length), 0), values.length - 1)];
}

// The values of a curve at other times, in order; nothing beyond its ends or beside what is unknown.
export function at(times: number[], t: number[], values: (number | null)[]): (number | null)[] {
  let before = 0;
  return times.map((time) => {
    if (!t.length || time < t[0] || time > t[t.length - 1]) return null;
    while (before < t.length - 2 && t[before + 1] < time) before += 1;
    const one = values[before], next = values[before + 1] ?? one;
    return one === null || next === null ? null : one + ((next - one) * (time - t[before])) / (t[before + 1] - t[before] || 1);
  });
}
