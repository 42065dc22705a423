/** Places labels beside their points so that they cover neither each other nor what must be seen. */

export interface Rectangle {
  x: number;
  y: number;
  width: number;
  height: number;
}

export interface Label {
  id: string;
  /** The point that is labeled, CSS pixels. */
  x: number;
  y: number;
  width: number;
  height: number;
  /** The direction in which the label should lie, rad on the screen. */
  direction: number;
  /** Higher ones are placed first. */
  priority: number;
}

/** Turns away from the wanted direction, the smallest first. */
const TURNS = [0, 0.6, -0.6, 1.2, -1.2, 1.9, -1.9, 2.6, -2.6, Math.PI];
const GAPS = [12, 26, 44];

export function overlaps(a: Rectangle, b: Rectangle, gap = 3): boolean {
  return a.x < b.x + b.width + gap && b.x < a.x + a.width + gap && a.y < b.y + b.height + gap && b.y < a.y + a.height + gap;
}

/** The rectangle of a label whose nearest edge is `gap` pixels from its point. */
function rectangleAt(label: Label, direction: number, gap: number): Rectangle {
  const [cos, sin] = [Math.cos(direction), Math.sin(direction)];
  const reach = gap + Math.min(label.width / 2 / Math.max(1e-6, Math.abs(cos)), label.height / 2 / Math.max(1e-6, Math.abs(sin)));
  return {
    x: label.x + cos * reach - label.width / 2,
    y: label.y + sin * reach - label.height / 2,
    width: label.width,
    height: label.height,
  };
}

/** The place of each label by its id. A label without room overlaps others at its wanted place. */
export function placeLabels(labels: readonly Label[], obstacles: readonly Rectangle[] = []): Map<string, Rectangle> {
  const placed = new Map<string, Rectangle>();
  const taken = [...obstacles];
  for (const label of labels.toSorted((a, b) => b.priority - a.priority || (a.id < b.id ? -1 : 1))) {
    const found = findRoom(label, taken) ?? rectangleAt(label, label.direction, GAPS[0] ?? 0);
    placed.set(label.id, found);
    taken.push(found);
  }
  return placed;
}

function findRoom(label: Label, taken: readonly Rectangle[]): Rectangle | null {
  for (const gap of GAPS) {
    for (const turn of TURNS) {
      const rectangle = rectangleAt(label, label.direction + turn, gap);
      if (!taken.some((other) => overlaps(rectangle, other))) return rectangle;
    }
  }
  return null;
}

/** The label at a point, with a few pixels around it; null where there is none. */
export function hitLabel(places: ReadonlyMap<string, Rectangle>, at: { x: number; y: number }): string | null {
  for (const [id, { x, y, width, height }] of places) {
    if (at.x >= x - 6 && at.x <= x + width + 6 && at.y >= y - 6 && at.y <= y + height + 6) return id;
  }
  return null;
}
