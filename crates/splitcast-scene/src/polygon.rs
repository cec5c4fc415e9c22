//! Polygons into triangles.
//!
//! Readers first store a polygon as a fan around its first corner, which is
//! right for every convex polygon. Once all positions are known, [`Polygons::mend`]
//! goes over the fans and replaces those of concave polygons by ear clipping
//! (Meisters, "Polygons have ears", American Mathematical Monthly 82, 1975;
//! kept to O(n²) as in Eberly, "Triangulation by ear clipping", 2002). Both
//! give `n - 2` triangles for `n` corners, so that nothing moves, and the fan
//! itself remembers the corners in order.

/// Largest concave polygon that is clipped; larger ones stay fans. Ear
/// clipping costs O(n²), and this bound keeps it linear in the file's size.
const MAX_CLIPPED_CORNERS: usize = 256;

/// The polygons of more than three corners among a list of triangles.
#[derive(Debug, Default)]
pub(crate) struct Polygons {
    /// First triangle and number of triangles of each fan.
    fans: Vec<(u32, u32)>,
}

impl Polygons {
    /// Appends a polygon to `triangles` as a fan. `corners` holds three or
    /// more; fewer add nothing.
    pub(crate) fn push(&mut self, corners: &[u32], triangles: &mut Vec<[u32; 3]>) {
        let first = triangles.len();
        if let [pivot, rest @ ..] = corners {
            triangles.extend(rest.windows(2).map(|pair| [*pivot, pair[0], pair[1]]));
        }
        let count = triangles.len() - first;
        if (2..=MAX_CLIPPED_CORNERS - 2).contains(&count) {
            self.fans.push((first as u32, count as u32));
        }
    }

    /// Replaces the fans of concave polygons. Every index in `triangles` must
    /// be below `positions.len()`.
    pub(crate) fn mend(&self, positions: &[[f32; 3]], triangles: &mut [[u32; 3]]) {
        let mut corners = Vec::new();
        let mut flat = Vec::new();
        for &(first, count) in &self.fans {
            let fan = &mut triangles[first as usize..first as usize + count as usize];
            corners.clear();
            corners.extend([fan[0][0], fan[0][1]]);
            corners.extend(fan.iter().map(|triangle| triangle[2]));
            project(&corners, positions, &mut flat);
            if !is_convex(&flat) {
                clip_ears(&corners, &flat, fan);
            }
        }
    }
}

/// Drops the axis along which the polygon's normal (Newell's sum) is longest,
/// so that the outline runs counter-clockwise in the plane that is left.
fn project(corners: &[u32], positions: &[[f32; 3]], flat: &mut Vec<[f64; 2]>) {
    let point = |corner: u32| positions[corner as usize].map(f64::from);
    let mut normal = [0.0_f64; 3];
    for (i, &corner) in corners.iter().enumerate() {
        let a = point(corner);
        let b = point(corners[(i + 1) % corners.len()]);
        for (axis, sum) in normal.iter_mut().enumerate() {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            *sum += (a[u] - b[u]) * (a[v] + b[v]);
        }
    }
    let size = normal.map(f64::abs);
    let axis = if size[0] >= size[1] && size[0] >= size[2] {
        0
    } else if size[1] >= size[2] {
        1
    } else {
        2
    };
    let (mut u, mut v) = ((axis + 1) % 3, (axis + 2) % 3);
    if normal[axis] < 0.0 {
        (u, v) = (v, u);
    }
    flat.clear();
    flat.extend(corners.iter().map(|&corner| {
        let p = point(corner);
        [p[u], p[v]]
    }));
}

/// Twice the signed area of a triangle, positive when counter-clockwise.
fn area(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Whether a fan covers the polygon: no fan triangle is turned over, and no
/// corner is reflex. Non-finite areas count as convex, since no clipping helps.
fn is_convex(flat: &[[f64; 2]]) -> bool {
    let n = flat.len();
    (0..n).all(|i| {
        let reflex = area(flat[i], flat[(i + 1) % n], flat[(i + 2) % n]) < 0.0;
        let turned = area(flat[0], flat[i], flat[(i + 1) % n]) < 0.0;
        !reflex && !turned
    })
}

/// Writes the polygon's `n - 2` triangles over its fan. An outline that
/// crosses itself may run out of ears; what is left is then a fan again.
fn clip_ears(corners: &[u32], flat: &[[f64; 2]], out: &mut [[u32; 3]]) {
    let mut ring: Vec<usize> = (0..corners.len()).collect();
    let mut ears: Vec<bool> = (0..ring.len()).map(|i| is_ear(&ring, i, flat)).collect();
    let mut out = out.iter_mut();
    while ring.len() > 3 {
        let Some(tip) = ears.iter().position(|&ear| ear) else {
            break;
        };
        let n = ring.len();
        let (before, after) = (ring[(tip + n - 1) % n], ring[(tip + 1) % n]);
        if let Some(slot) = out.next() {
            *slot = [before, ring[tip], after].map(|i| corners[i]);
        }
        ring.remove(tip);
        ears.remove(tip);
        // Cutting an ear changes only the angles at its two neighbours.
        for neighbour in [(tip + n - 2) % (n - 1), tip % (n - 1)] {
            ears[neighbour] = is_ear(&ring, neighbour, flat);
        }
    }
    for (pair, slot) in ring[1..].windows(2).zip(out) {
        *slot = [ring[0], pair[0], pair[1]].map(|i| corners[i]);
    }
}

/// Whether the corner at `tip` of the ring can be cut off: it is convex and
/// no other corner lies in its triangle.
fn is_ear(ring: &[usize], tip: usize, flat: &[[f64; 2]]) -> bool {
    let n = ring.len();
    let [a, b, c] = [ring[(tip + n - 1) % n], ring[tip], ring[(tip + 1) % n]].map(|i| flat[i]);
    if area(a, b, c) <= 0.0 {
        return false;
    }
    ring.iter().map(|&i| flat[i]).all(|p| {
        // Corners that share a place with the triangle's own are the seams of
        // polygons with holes, and do not block.
        p == a
            || p == b
            || p == c
            || area(a, b, p) < 0.0
            || area(b, c, p) < 0.0
            || area(c, a, p) < 0.0
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangulates an outline in a tilted plane and returns the areas in it.
    fn areas(outline: &[[f64; 2]]) -> Vec<f64> {
        let positions: Vec<[f32; 3]> = outline
            .iter()
            .map(|p| [p[0] as f32, p[1] as f32, (p[0] * 0.25 + p[1] * 0.5) as f32])
            .collect();
        let corners: Vec<u32> = (0..outline.len() as u32).collect();
        let mut triangles = vec![[9, 9, 9]];
        let mut polygons = Polygons::default();
        polygons.push(&corners, &mut triangles);
        polygons.mend(&positions, &mut triangles);
        assert_eq!(triangles.len(), outline.len() - 2 + 1);
        assert_eq!(triangles[0], [9, 9, 9]);
        triangles[1..]
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| outline[i as usize]);
                area(a, b, c)
            })
            .collect()
    }

    fn outline_area(outline: &[[f64; 2]]) -> f64 {
        (1..outline.len() - 1)
            .map(|i| area(outline[0], outline[i], outline[i + 1]))
            .sum()
    }

    #[test]
    fn concave_outlines_are_covered_without_turned_triangles() {
        let dart = [[0.0, 0.0], [4.0, 0.0], [1.0, 1.0], [0.0, 4.0]];
        for start in 0..4 {
            let mut turned = dart;
            turned.rotate_left(start);
            check(&turned);
        }
        let comb: Vec<[f64; 2]> = (0..40)
            .map(|i| [f64::from(i), if i % 2 == 0 { 8.0 } else { 1.0 }])
            .rev()
            .chain([[-1.0, 0.0], [41.0, 0.0]])
            .collect();
        check(&comb);
        let star: Vec<[f64; 2]> = (0..30)
            .map(|i| {
                let angle = f64::from(i) * std::f64::consts::TAU / 30.0;
                let radius = if i % 2 == 0 { 3.0 } else { 1.0 };
                [radius * angle.cos(), radius * angle.sin()]
            })
            .collect();
        check(&star);
        // A square with a square hole, joined by a seam walked twice.
        check(&[
            [0.0, 0.0],
            [6.0, 0.0],
            [6.0, 6.0],
            [0.0, 6.0],
            [0.0, 0.0],
            [2.0, 2.0],
            [2.0, 4.0],
            [4.0, 4.0],
            [4.0, 2.0],
            [2.0, 2.0],
        ]);
    }

    fn check(outline: &[[f64; 2]]) {
        let areas = areas(outline);
        assert!(areas.iter().all(|&a| a >= 0.0), "{outline:?}: {areas:?}");
        let (sum, whole) = (areas.iter().sum::<f64>(), outline_area(outline));
        assert!((sum - whole).abs() < 1e-9, "{sum} of {whole}");
    }

    #[test]
    fn convex_outlines_stay_fans() {
        let mut triangles = Vec::new();
        let mut polygons = Polygons::default();
        polygons.push(&[3, 2, 1, 0], &mut triangles);
        let square = [
            [0.0, 0.0, 5.0],
            [0.0, 1.0, 5.0],
            [1.0, 1.0, 5.0],
            [1.0, 0.0, 5.0],
        ];
        polygons.mend(&square, &mut triangles);
        assert_eq!(triangles, [[3, 2, 1], [3, 1, 0]]);
    }

    #[test]
    fn crossed_flat_and_non_finite_outlines_end_in_triangles() {
        for outline in [
            vec![[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]],
            vec![[0.0, 0.0]; 7],
            vec![
                [0.0, 0.0],
                [f64::NAN, 1.0],
                [1.0, 0.0],
                [0.0, f64::INFINITY],
                [2.0, -3.0],
            ],
        ] {
            areas(&outline);
        }
    }
}
