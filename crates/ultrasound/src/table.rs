//! A value for every column of the lattice, filled in as columns are asked for.

use core::ops::Range;

const SIDE: usize = 32;

/// Values of SIDE × SIDE columns.
struct Tile<T> {
    /// Columns whose values were set: a word per row, a bit per column.
    set: [u32; SIDE],
    values: [T; SIDE * SIDE],
}

/// Values in tiles, which are made when one of their columns is set.
pub struct Table<T> {
    half: [i32; 2],
    tiles: Vec<Option<Box<Tile<T>>>>,
}

impl<T: Copy + Default> Table<T> {
    /// Columns exist for −half ≤ index < half, along x and y; `half` is rounded up to whole tiles.
    pub fn new(half: [i32; 2]) -> Self {
        let half = half.map(|h| (h + SIDE as i32 - 1) / SIDE as i32 * SIDE as i32);
        let [across, along] = half.map(|h| 2 * h as usize / SIDE);
        Self { half, tiles: (0..across * along).map(|_| None).collect() }
    }

    /// Columns exist for −half ≤ index < half.
    pub fn half(&self) -> [i32; 2] {
        self.half
    }

    /// Index of a column's tile, and of its row and place in it; `None` outside.
    #[inline]
    fn place(&self, ix: i32, iy: i32) -> Option<(usize, [usize; 2])> {
        let [hx, hy] = self.half;
        if ix < -hx || ix >= hx || iy < -hy || iy >= hy {
            return None;
        }
        let (i, j) = ((ix + hx) as usize, (iy + hy) as usize);
        Some((j / SIDE * (2 * hx as usize / SIDE) + i / SIDE, [j % SIDE, i % SIDE]))
    }

    /// Sets a column's value; nothing outside.
    pub fn set(&mut self, ix: i32, iy: i32, value: T) {
        let Some((tile, [row, column])) = self.place(ix, iy) else { return };
        let tile = self.tiles[tile]
            .get_or_insert_with(|| Box::new(Tile { set: [0; SIDE], values: [T::default(); SIDE * SIDE] }));
        tile.set[row] |= 1 << column;
        tile.values[row * SIDE + column] = value;
    }

    /// A value that was set; the default outside.
    #[inline]
    pub fn get(&self, ix: i32, iy: i32) -> T {
        let Some((tile, [row, column])) = self.place(ix, iy) else { return T::default() };
        let tile = self.tiles[tile].as_ref();
        debug_assert!(tile.is_some_and(|tile| tile.set[row] >> column & 1 == 1), "{ix}, {iy} was not set");
        tile.map_or_else(T::default, |tile| tile.values[row * SIDE + column])
    }

    /// The first of these columns of a row whose value was not set; `None` also where none exist.
    #[inline]
    pub fn first_unset(&self, columns: Range<i32>, iy: i32) -> Option<i32> {
        let [hx, _] = self.half;
        let (mut ix, end) = (columns.start.max(-hx), columns.end.min(hx));
        while ix < end {
            let (tile, [row, column]) = self.place(ix, iy)?;
            let set = self.tiles[tile].as_ref().map_or(0, |tile| tile.set[row]) >> column;
            let ahead = (SIDE - column).min((end - ix) as usize) as i32;
            let known = (set.trailing_ones() as i32).min(ahead);
            if known < ahead {
                return Some(ix + known);
            }
            ix += ahead;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_set_is_there_and_the_rest_is_missing() {
        let mut table = Table::new([40, 5]);
        assert_eq!(table.half(), [64, 32]);
        for iy in [-32, -1, 0, 31] {
            let mut missing: Vec<i32> = (-64..64).collect();
            for (step, ix) in [(7, -64), (11, 63), (5, -1), (13, 0)].into_iter().flat_map(|(step, first)| {
                (0..9).map(move |i| (step, (first + step * i + 64i32).rem_euclid(128) - 64))
            }) {
                table.set(ix, iy, step * 1000 + ix);
                missing.retain(|&other| other != ix);
                assert_eq!(table.get(ix, iy), step * 1000 + ix);
            }
            let mut found = Vec::new();
            let mut from = -100;
            while let Some(ix) = table.first_unset(from..100, iy) {
                found.push(ix);
                from = ix + 1;
            }
            assert_eq!(found, missing, "row {iy}");
        }
        table.set(64, 0, 1);
        table.set(0, -33, 1);
        assert_eq!((table.get(64, 0), table.get(0, -33)), (0, 0));
        assert_eq!(table.first_unset(64..70, 0), None);
        assert_eq!(table.first_unset(0..9, 32), None);
    }
}
