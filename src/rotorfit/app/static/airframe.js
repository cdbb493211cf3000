// The vehicle as it is drawn, and the [airframe] table that says the same. Axes FLU, metres.

export const LAYOUT_WORDS = {
  "quad-x": "Quad X", "quad-plus": "Quad +", "hexa-x": "Hexa X", "hexa-plus": "Hexa +",
  "octo-x": "Octo X", "octo-plus": "Octo +", "octo-coax-x": "Octo coaxial (X8)" };
export const ORDER_WORDS = {
  px4: "PX4", ardupilot: "ArduPilot", betaflight: "Betaflight, INAV, INDIflight",
  crazyflie: "Crazyflie", paper: "the paper (Six et al.)" };

/** Layouts by name and motor order, at arms of 1 m; the engine tells them. */
let layouts = [];

export function setLayouts(known) {
  layouts = known;
}

export const layoutNames = () => [...new Set(layouts.map((one) => one.layout))];

export const ordersOf = (layout) =>
  layouts.filter((one) => one.layout === layout).map((one) => one.order);

const named = (layout, order) =>
  layouts.find((one) => one.layout === layout && one.order === order);

export const rotorCount = (layout) =>
  layouts.find((one) => one.layout === layout)?.rotors.length ?? 0;

export function newVehicle() {
  return { layout: "quad-x", order: "betaflight", measure: "arm", arm: null, spacing: [null, null],
    unit: "mm", listed: null, seats: [], reversed: [], touched: false };
}

/** The size has been given, or the rotors are listed with their places. */
export function hasSize(vehicle) {
  if (vehicle.listed) return true;
  return (vehicle.measure === "arm" ? [vehicle.arm] : vehicle.spacing).every((x) => x > 0);
}

/** The rotors in the order of the log's motors; of a size to draw with where none was given. */
export function rotorsOf(vehicle) {
  const base = vehicle.listed ?? placed(vehicle);
  const seats = vehicle.seats.length ? vehicle.seats : base.map((_, i) => i);
  return seats.map((seat) => {
    const rotor = base[seat];
    const other = rotor.spin === "ccw" ? "cw" : "ccw";
    return { ...rotor, spin: vehicle.reversed.includes(seat) ? other : rotor.spin };
  });
}

function placed(vehicle) {
  const { rotors } = named(vehicle.layout, vehicle.order) ?? { rotors: [] };
  const [sx, sy] = factors(vehicle, rotors);
  return rotors.map(({ position: [x, y, z], spin }) =>
    ({ position: [nano(x * sx), nano(y * sy), z], spin }));
}

/** How long and how wide a layout at arms of 1 m becomes. */
function factors(vehicle, rotors) {
  if (!hasSize(vehicle)) return [1, 1];
  if (vehicle.measure === "arm") return [vehicle.arm, vehicle.arm];
  return vehicle.spacing.map((length, axis) => length / extent(rotors, axis));
}

export function extent(rotors, axis) {
  const places = rotors.map((rotor) => rotor.position[axis]);
  return Math.max(...places) - Math.min(...places);
}

const nano = (x) => Number(x.toFixed(9)) + 0;

/** Turn one motor's spin round. */
export function reverse(vehicle, motor) {
  const seat = vehicle.seats[motor] ?? motor;
  const { reversed } = vehicle;
  return { ...vehicle, touched: true,
    reversed: reversed.includes(seat) ? reversed.filter((s) => s !== seat) : [...reversed, seat] };
}

export function reverseAll(vehicle) {
  return rotorsOf(vehicle).reduce((now, _, motor) => reverse(now, motor), vehicle);
}

/** Exchange the numbers of two motors. */
export function swap(vehicle, a, b) {
  const seats = rotorsOf(vehicle).map((_, i) => vehicle.seats[i] ?? i);
  [seats[a], seats[b]] = [seats[b], seats[a]];
  return { ...vehicle, touched: true, seats: seats.every((s, i) => s === i) ? [] : seats };
}

/** Another layout or order: the clicks on the old one are gone with it. */
export function relaid(vehicle, layout, order) {
  const orders = ordersOf(layout);
  return { ...vehicle, layout, order: orders.includes(order) ? order : orders[0],
    listed: null, seats: [], reversed: [], touched: true };
}

/** As a layout of the list, unless motors were clicked: then rotor by rotor. */
export function airframeTable(vehicle) {
  if (!vehicle.listed && !vehicle.seats.length && !vehicle.reversed.length) {
    const size = vehicle.measure === "arm" ? { arm: vehicle.arm } : { spacing: vehicle.spacing };
    return { layout: vehicle.layout, order: vehicle.order, ...size };
  }
  return { rotors: rotorsOf(vehicle) };
}

/** The vehicle of an [airframe] table; what else the table holds is kept beside it. */
export function vehicleOf(table, unit = "mm") {
  const { rotors, layout, order = "px4", arm, spacing } = table;
  const vehicle = { ...newVehicle(), unit, touched: true };
  if (rotors) return { ...vehicle, listed: rotors };
  return { ...vehicle, layout, order, measure: spacing ? "spacing" : "arm", arm: arm ?? null,
    spacing: spacing ?? [null, null] };
}

const ROWS = [[1, "front"], [-1, "rear"]];
const SIDES = [[1, "left"], [-1, "right"]];

/** Where a motor sits, in words. */
export function seatWords([x, y], size) {
  const words = [
    ...ROWS.filter(([sign]) => sign * x > 0.1 * size).map(([, word]) => word),
    ...SIDES.filter(([sign]) => sign * y > 0.1 * size).map(([, word]) => word),
  ];
  return words.join(" ") || "centre";
}
