//! Small pictures of a scene, as in Figure 2 of Hussain & Grahn 2008.

use splitcast::Aabb;
use splitcast_console::Progress;
use splitcast_render::{
    Camera, DEFAULT_FOV_DEGREES, Perspective, Quality, RenderOptions, Renderer, encode_png,
};
use splitcast_report::Image;

use super::settings::{Contender, Settings};
use crate::error::CliError;
use crate::scene::Scene;
use crate::trees::build_tree;

/// Most pictures of a scene.
const PICTURES: usize = 8;

/// Pictures of frames that are evenly spread, the first and the last among them.
pub(crate) fn render(scene: &mut Scene, settings: &Settings) -> Result<Vec<Image>, CliError> {
    let options = RenderOptions {
        width: 240,
        height: 135,
        samples_per_pixel: Some(16),
        quality: Quality::Draft,
        ..RenderOptions::default()
    };
    let aspect = options.width as f32 / options.height as f32;
    let view = Perspective::framing(&scene.info.outline, options.up, aspect, DEFAULT_FOV_DEGREES)?;
    let bounds = scene.info.bounds.map_or(Aabb::EMPTY, |bounds| Aabb {
        min: bounds.min,
        max: bounds.max,
    });
    let renderer = Renderer::new(Camera::new(&view)?, &bounds, options)?;
    let mut builder = settings.builder(Contender::Binned)?;
    let chosen = spread(scene.measured.len());
    let mut progress = Progress::new("drawing", chosen.len());
    let mut pictures = Vec::with_capacity(chosen.len());
    for index in chosen
        .into_iter()
        .map(|at| scene.measured[at])
        .collect::<Vec<_>>()
    {
        let number = scene.number(index);
        let frame = scene.frame(index)?;
        let tree = build_tree(&frame, &mut builder, number, &scene.place(index))?;
        let (image, _) = renderer.render(&tree, &frame)?;
        let picture = Image::png(&encode_png(&image)?, format!("frame {number}"));
        pictures.push(picture.map_err(|error| CliError::Frame {
            index: number,
            place: scene.place(index),
            reason: error.to_string(),
        })?);
        progress.step("");
    }
    Ok(pictures)
}

/// At most [`PICTURES`] of the numbers below `count`, evenly spread.
fn spread(count: usize) -> Vec<usize> {
    let pictures = count.min(PICTURES);
    let last = pictures.saturating_sub(1).max(1);
    (0..pictures)
        .map(|picture| (picture * count.saturating_sub(1) + last / 2) / last)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_spread_from_the_first_frame_to_the_last() {
        assert_eq!(spread(1), [0]);
        assert_eq!(spread(3), [0, 1, 2]);
        assert_eq!(spread(15), [0, 2, 4, 6, 8, 10, 12, 14]);
        assert_eq!(spread(16).len(), 8);
        assert_eq!(spread(73).last(), Some(&72));
    }
}
