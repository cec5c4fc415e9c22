//! Small generators of meshes, and the random numbers they use.

use std::collections::BTreeMap;

/// Positions and triangles that own themselves.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Soup {
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// SplitMix64 (Steele, Lea & Flood 2014): small, seeded, the same everywhere.
#[derive(Clone, Debug)]
pub(crate) struct Rng(pub(crate) u64);

impl Rng {
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Uniform in [-1, 1).
    pub(crate) fn signed(&mut self) -> f32 {
        2.0 * self.unit() - 1.0
    }

    pub(crate) fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    pub(crate) fn in_cube(&mut self) -> [f32; 3] {
        [self.signed(), self.signed(), self.signed()]
    }

    /// Uniform on the unit sphere.
    pub(crate) fn direction(&mut self) -> [f32; 3] {
        loop {
            let v = self.in_cube();
            let square = v.iter().map(|x| x * x).sum::<f32>();
            if square > 1e-4 && square <= 1.0 {
                return v.map(|x| x / square.sqrt());
            }
        }
    }
}

impl Soup {
    pub(crate) fn push(&mut self, corners: [[f32; 3]; 3]) {
        let first = self.positions.len() as u32;
        self.positions.extend(corners);
        self.triangles.push([first, first + 1, first + 2]);
    }

    pub(crate) fn append(&mut self, other: &Self) {
        let first = self.positions.len() as u32;
        self.positions.extend(&other.positions);
        let shifted = other
            .triangles
            .iter()
            .map(|t| t.map(|vertex| vertex + first));
        self.triangles.extend(shifted);
    }

    /// Every position replaced.
    #[must_use]
    pub(crate) fn mapped(mut self, map: impl FnMut([f32; 3]) -> [f32; 3]) -> Self {
        self.positions = self.positions.into_iter().map(map).collect();
        self
    }

    #[must_use]
    pub(crate) fn scaled(self, factor: f32) -> Self {
        self.mapped(|p| p.map(|x| x * factor))
    }

    #[must_use]
    pub(crate) fn moved(self, by: [f32; 3]) -> Self {
        self.mapped(|p| std::array::from_fn(|k| p[k] + by[k]))
    }
}

/// A closed sphere of `8 · 4^levels` triangles: an octahedron, subdivided.
pub(crate) fn sphere(levels: u32) -> Soup {
    let mut positions = vec![
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0f32],
    ];
    let mut triangles = vec![
        [0, 2, 4],
        [2, 1, 4],
        [1, 3, 4],
        [3, 0, 4],
        [2, 0, 5],
        [1, 2, 5],
        [3, 1, 5],
        [0, 3, 5u32],
    ];
    for _ in 0..levels {
        let mut middles = BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let (p, q) = (positions[a as usize], positions[b as usize]);
                let sum: [f32; 3] = std::array::from_fn(|k| p[k] + q[k]);
                let length = sum.iter().map(|x| x * x).sum::<f32>().sqrt();
                positions.push(sum.map(|x| x / length));
                positions.len() as u32 - 1
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    Soup {
        positions,
        triangles,
    }
}

/// A closed box from -1 to 1 with `2 · side²` triangles on each face.
pub(crate) fn closed_box(side: u32) -> Soup {
    let width = side + 1;
    let mut soup = Soup::default();
    for face in 0..6 {
        let first = soup.positions.len() as u32;
        let at = |i: u32| 2.0 * i as f32 / side as f32 - 1.0;
        for k in 0..width * width {
            let mut position = [at(k % width), at(k / width), (2 * (face % 2)) as f32 - 1.0];
            position.rotate_left(face / 2);
            soup.positions.push(position);
        }
        for k in (0..width * side).filter(|k| k % width < side) {
            let corner = first + k;
            let above = corner + width;
            soup.triangles.push([corner, corner + 1, above]);
            soup.triangles.push([corner + 1, above + 1, above]);
        }
    }
    soup
}

/// [`sphere`] with waves on it that move with `phase`: creases, folds, bumps.
pub(crate) fn bumpy_sphere(levels: u32, phase: f32) -> Soup {
    sphere(levels).mapped(|[x, y, z]| {
        let wave =
            (7.0 * x + phase).sin() + (9.0 * y - phase).sin() + (8.0 * z + 2.0 * phase).cos();
        let radius = 1.0 + 0.08 * wave + 0.02 * (31.0 * (x + y + z) + phase).sin();
        [x * radius, y * radius, z * radius]
    })
}

/// A wavy sheet of `2 * n * n` triangles whose waves have moved by `phase`.
pub(crate) fn sheet(n: u32, phase: f32) -> Soup {
    let position = |i: u32, j: u32| {
        let (x, y) = (i as f32 / n as f32, j as f32 / n as f32);
        // Polynomials only: the same on every platform.
        [x, y, (x - 0.3 - phase) * (y - 0.6 + phase) * (x - y)]
    };
    let rows = (0..=n).flat_map(|i| (0..=n).map(move |j| position(i, j)));
    let corners = (0..n).flat_map(|i| (0..n).map(move |j| i * (n + 1) + j));
    Soup {
        positions: rows.collect(),
        triangles: corners
            .flat_map(|a| [[a, a + n + 1, a + n + 2], [a, a + n + 2, a + 1]])
            .collect(),
    }
}
