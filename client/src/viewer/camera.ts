// A view's camera: from places of the world to pixels, and back at a depth.
export type Place = [number, number, number];

export class Camera {
  private readonly inverse: number[];

  /** matrix: [3, 4], row by row, from (x, y, z, 1) to (d · column, d · row, d). */
  constructor(private readonly matrix: readonly number[]) {
    const m = (row: number, column: number) => matrix[4 * row + column] ?? 0;
    const minor = (r: number, c: number) => {
      const [r1, r2] = [(r + 1) % 3, (r + 2) % 3];
      const [c1, c2] = [(c + 1) % 3, (c + 2) % 3];
      return m(r1, c1) * m(r2, c2) - m(r1, c2) * m(r2, c1);
    };
    const determinant = m(0, 0) * minor(0, 0) + m(0, 1) * minor(0, 1) + m(0, 2) * minor(0, 2);
    this.inverse = [0, 1, 2].flatMap((r) => [0, 1, 2].map((c) => minor(c, r) / determinant));
  }

  /** Column, row and depth of a place; nothing of it is seen where the depth is not above 0. */
  project([x, y, z]: Place): Place {
    const [a, b, d] = [0, 1, 2].map((row) => {
      const at = (column: number) => this.matrix[4 * row + column] ?? 0;
      return at(0) * x + at(1) * y + at(2) * z + at(3);
    }) as Place;
    return [a / d, b / d, d];
  }

  /** The place at a column, a row and a depth. */
  unproject([column, row, depth]: Place): Place {
    const h = [column * depth, row * depth, depth].map((value, k) => value - (this.matrix[4 * k + 3] ?? 0));
    return [0, 1, 2].map((k) =>
      [0, 1, 2].reduce((sum, j) => sum + (this.inverse[3 * k + j] ?? 0) * (h[j] ?? 0), 0),
    ) as Place;
  }
}
