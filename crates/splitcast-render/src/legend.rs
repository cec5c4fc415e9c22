//! The legend of a debug view, drawn into the lower right corner of the picture,
//! where the default camera has nothing but ground.

use glam::Vec3;

use crate::Image;

/// Pictures with fewer rows or columns get no legend: it would hide them.
const SMALLEST: u32 = 160;

/// One pixel of a letter stands for one row in this many, rounded.
const ROWS_PER_DOT: f32 = 320.0;

/// Width and height of a letter in dots, and from one letter to the next.
const LETTER: [usize; 2] = [5, 7];
const ADVANCE: usize = 6;

/// Length and height of the colour bar in dots.
const BAR: [usize; 2] = [120, 6];

/// Edge of a swatch in dots.
const SWATCH: usize = 7;

/// Opacity of the plate under the legend.
const PLATE: f32 = 0.72;

/// A legend's text.
const INK: Vec3 = Vec3::splat(0.9);

/// The letters that legends use: seven rows of five dots, the leftmost in the
/// highest bit.
#[rustfmt::skip]
const LETTERS: &[(char, [u8; 7])] = &[
    ('0', [0x0e, 0x11, 0x13, 0x15, 0x19, 0x11, 0x0e]),
    ('1', [0x04, 0x0c, 0x04, 0x04, 0x04, 0x04, 0x0e]),
    ('2', [0x0e, 0x11, 0x01, 0x02, 0x04, 0x08, 0x1f]),
    ('3', [0x1f, 0x02, 0x04, 0x02, 0x01, 0x11, 0x0e]),
    ('4', [0x02, 0x06, 0x0a, 0x12, 0x1f, 0x02, 0x02]),
    ('5', [0x1f, 0x10, 0x1e, 0x01, 0x01, 0x11, 0x0e]),
    ('6', [0x06, 0x08, 0x10, 0x1e, 0x11, 0x11, 0x0e]),
    ('7', [0x1f, 0x01, 0x02, 0x04, 0x08, 0x08, 0x08]),
    ('8', [0x0e, 0x11, 0x11, 0x0e, 0x11, 0x11, 0x0e]),
    ('9', [0x0e, 0x11, 0x11, 0x0f, 0x01, 0x02, 0x0c]),
    ('+', [0x00, 0x04, 0x04, 0x1f, 0x04, 0x04, 0x00]),
    ('a', [0x00, 0x00, 0x0e, 0x01, 0x0f, 0x11, 0x0f]),
    ('c', [0x00, 0x00, 0x0e, 0x10, 0x10, 0x11, 0x0e]),
    ('d', [0x01, 0x01, 0x0d, 0x13, 0x11, 0x11, 0x0f]),
    ('e', [0x00, 0x00, 0x0e, 0x11, 0x1f, 0x10, 0x0e]),
    ('f', [0x06, 0x09, 0x08, 0x1c, 0x08, 0x08, 0x08]),
    ('h', [0x10, 0x10, 0x16, 0x19, 0x11, 0x11, 0x11]),
    ('i', [0x04, 0x00, 0x0c, 0x04, 0x04, 0x04, 0x0e]),
    ('l', [0x0c, 0x04, 0x04, 0x04, 0x04, 0x04, 0x0e]),
    ('m', [0x00, 0x00, 0x1a, 0x15, 0x15, 0x15, 0x15]),
    ('n', [0x00, 0x00, 0x16, 0x19, 0x11, 0x11, 0x11]),
    ('o', [0x00, 0x00, 0x0e, 0x11, 0x11, 0x11, 0x0e]),
    ('p', [0x00, 0x00, 0x1e, 0x11, 0x11, 0x1e, 0x10]),
    ('r', [0x00, 0x00, 0x16, 0x19, 0x10, 0x10, 0x10]),
    ('s', [0x00, 0x00, 0x0e, 0x10, 0x0e, 0x01, 0x1e]),
    ('t', [0x08, 0x08, 0x1c, 0x08, 0x08, 0x09, 0x06]),
    ('v', [0x00, 0x00, 0x11, 0x11, 0x11, 0x0a, 0x04]),
    ('x', [0x00, 0x00, 0x11, 0x0a, 0x04, 0x0a, 0x11]),
    ('y', [0x00, 0x00, 0x11, 0x11, 0x0f, 0x01, 0x0e]),
    ('z', [0x00, 0x00, 0x1f, 0x02, 0x04, 0x08, 0x1f]),
];

/// Draws a bar of the colours that `color` gives for 0 to 1, a title above it,
/// and what its ends stand for below it.
pub(crate) fn draw_bar(
    image: &mut Image,
    title: &str,
    ends: [&str; 2],
    color: impl Fn(f32) -> Vec3,
) {
    let [length, height] = BAR;
    let plate = [length, LETTER[1] + height + LETTER[1] + 6];
    let Some(mut pen) = Pen::new(image, plate) else {
        return;
    };
    pen.text(0, 0, title);
    let top = LETTER[1] + 3;
    for x in 0..length {
        let ink = color(x as f32 / (length - 1) as f32);
        for y in 0..height {
            pen.dot(x, top + y, ink);
        }
    }
    let below = top + height + 3;
    pen.text(0, below, ends[0]);
    pen.text(length - text_width(ends[1]), below, ends[1]);
}

/// Draws a title and, after it, a swatch and a name for each entry.
pub(crate) fn draw_swatches(image: &mut Image, title: &str, entries: &[(&str, Vec3)]) {
    let gap = 2 * ADVANCE;
    let width = entries.iter().fold(text_width(title), |width, (name, _)| {
        width + gap + SWATCH + 3 + text_width(name)
    });
    let Some(mut pen) = Pen::new(image, [width, LETTER[1]]) else {
        return;
    };
    pen.text(0, 0, title);
    let mut x = text_width(title);
    for &(name, ink) in entries {
        x += gap;
        for (dx, dy) in (0..SWATCH).flat_map(|dx| (0..SWATCH).map(move |dy| (dx, dy))) {
            pen.dot(x + dx, dy, ink);
        }
        x += SWATCH + 3;
        pen.text(x, 0, name);
        x += text_width(name);
    }
}

fn text_width(text: &str) -> usize {
    text.len() * ADVANCE - (ADVANCE - LETTER[0])
}

/// Draws dots relative to the upper left corner of a legend.
struct Pen<'i> {
    image: &'i mut Image,
    /// Pixels along the side of a dot.
    dot: usize,
    left: usize,
    top: usize,
}

impl<'i> Pen<'i> {
    /// Darkens the plate for a legend of the given size in dots; `None` if it
    /// would not fit the picture.
    fn new(image: &'i mut Image, size: [usize; 2]) -> Option<Self> {
        let (width, height) = (image.width as usize, image.height as usize);
        let dot = ((image.height as f32 / ROWS_PER_DOT).round() as usize).max(1);
        let border = 5 * dot;
        let [legend_width, legend_height] = size.map(|dots| dots * dot + 2 * border);
        let fits = legend_width + border <= width && 2 * (legend_height + border) <= height;
        if image.width.min(image.height) < SMALLEST || !fits {
            return None;
        }
        let (left, top) = (
            width - border - legend_width,
            height - border - legend_height,
        );
        for y in top..top + legend_height {
            for pixel in &mut image.pixels[y * width + left..][..legend_width] {
                *pixel = pixel.map(|channel| channel * (1.0 - PLATE));
            }
        }
        Some(Self {
            image,
            dot,
            left: left + border,
            top: top + border,
        })
    }

    fn dot(&mut self, x: usize, y: usize, ink: Vec3) {
        let (left, top) = (self.left + x * self.dot, self.top + y * self.dot);
        for row in top..top + self.dot {
            let start = row * self.image.width as usize + left;
            self.image.pixels[start..start + self.dot].fill(ink.into());
        }
    }

    fn text(&mut self, left: usize, top: usize, text: &str) {
        for (place, letter) in text.chars().enumerate() {
            let Some((_, rows)) = LETTERS.iter().find(|&&(known, _)| known == letter) else {
                continue;
            };
            for (y, row) in rows.iter().enumerate() {
                for x in (0..LETTER[0]).filter(|x| row >> (LETTER[0] - 1 - x) & 1 == 1) {
                    self.dot(left + place * ADVANCE + x, top + y, INK);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ToneCurve;

    fn grey(width: u32, height: u32) -> Image {
        Image {
            width,
            height,
            pixels: vec![[0.5; 3]; (width * height) as usize],
            tone_curve: ToneCurve::Exact,
        }
    }

    #[test]
    fn a_legend_fits_every_size_or_is_left_out() {
        for (width, height) in [(1, 1), (159, 400), (160, 160), (300, 170), (1920, 1080)] {
            let mut image = grey(width, height);
            draw_bar(&mut image, "nodes visited", ["0", "80+"], Vec3::splat);
            draw_swatches(&mut image, "planes", &[("x", Vec3::X)]);
            let drawn = image.pixels.iter().any(|&pixel| pixel != [0.5; 3]);
            assert_eq!(drawn, width.min(height) >= SMALLEST, "{width}x{height}");
        }
    }

    #[test]
    fn every_letter_can_be_written() {
        let titles = ["nodes visited", "leaf depth", "planes across", "normals"];
        let others = ["0123456789+", "xyz"];
        for letter in titles.into_iter().chain(others).flat_map(str::chars) {
            let known = LETTERS.iter().any(|&(known, _)| known == letter);
            assert!(known || letter == ' ', "{letter}");
        }
    }

    #[test]
    fn the_bar_shows_all_of_its_colors() {
        let mut image = grey(320, 240);
        draw_bar(&mut image, "", ["0", "1"], |x| Vec3::new(x, 0.0, 1.0));
        for expected in [[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]] {
            assert!(image.pixels.contains(&expected));
        }
    }
}
