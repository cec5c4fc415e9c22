//! Prediction of many independent scalars from frame to frame, such as the
//! positions of split planes.
//!
//! Every [`Predictor`] is driven in the same way, once a frame:
//!
//! ```text
//! predict() ─► search near the predictions ─► carry_over(sources, initial) ─► correct(observations)
//! ```
//!
//! [`KalmanFilter`] is the filter of Hussain & Grahn 2008, with the noise of
//! their Algorithm 1 from [`NoiseParameters`] and its virtual observations
//! from [`VirtualObservations`]. [`WienerPredictor`] learns weights for the
//! last displacements from the motion itself.
//!
//! ```
//! use splitcast::filter::{KalmanFilter, NEW_COMPONENT, NoiseParameters, Predictor};
//!
//! let planes = [0.5, 0.25, 0.75];
//! let model = NoiseParameters::default().kalman_model(&planes)?;
//! let mut filter = KalmanFilter::new(model, 0)?;
//! filter.load(&planes);
//!
//! assert_eq!(filter.predict(), planes);
//! // The second plane is gone, and a new one stands at its end.
//! filter.carry_over(&[0, 2, NEW_COMPONENT], &[0.52, 0.77, 0.9]);
//! filter.correct(&[0.52, 0.77, 0.9]);
//! assert!(filter.state()[0] > 0.5 && filter.state()[0] < 0.52);
//! assert_eq!(filter.state()[2], 0.9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod kalman;
mod noise;
mod wiener;

pub use kalman::{KalmanFilter, KalmanModel, ModelError};
pub use noise::{NoiseError, NoiseParameters, VirtualObservations};
pub use wiener::{WienerError, WienerParameters, WienerPredictor};

/// The source of a component that takes over nothing, for
/// [`Predictor::carry_over`].
pub const NEW_COMPONENT: u32 = u32::MAX;

/// A predictor of independent scalar components, each from its own past
/// observations.
///
/// An observation that is not finite counts as missing: the prediction stands
/// in its place.
pub trait Predictor {
    /// Number of components.
    fn len(&self) -> usize;

    /// Whether there are no components.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Starts every component anew, one for each position in `initial`, which is taken to be
    /// exact. What was learned about all components together stays.
    fn load(&mut self, initial: &[f32]);

    /// Advances to the next frame and returns what is expected there, in the
    /// unit of the observations, one value a component.
    fn predict(&mut self) -> &[f32];

    /// Re-indexes the components after the set of what is tracked has
    /// changed: component `i` takes over all that was known of component `sources[i]`, or
    /// starts anew at `initial[i]` if its source is [`NEW_COMPONENT`]. One
    /// source may serve any number of components, or none.
    ///
    /// # Panics
    /// If `sources` and `initial` differ in length, or a source is neither
    /// [`NEW_COMPONENT`] nor below [`Predictor::len`].
    fn carry_over(&mut self, sources: &[u32], initial: &[f32]);

    /// Takes in what was observed in this frame, one value a component.
    ///
    /// # Panics
    /// If the number of observations is not [`Predictor::len`].
    fn correct(&mut self, observations: &[f32]);
}

/// Panics unless `sources` and `initial` are fit for [`Predictor::carry_over`].
fn check_sources(sources: &[u32], initial: &[f32], components: usize) {
    assert_eq!(
        sources.len(),
        initial.len(),
        "carry_over: number of sources (left) and of initial positions (right) differ"
    );
    if let Some((i, source)) = (sources.iter().enumerate())
        .find(|&(_, &source)| source != NEW_COMPONENT && source as usize >= components)
    {
        panic!("carry_over: source {source} of component {i} is not below {components}");
    }
}

/// Panics unless there is one of `what` for each component.
fn check_count(what: &str, count: usize, components: usize) {
    assert_eq!(
        count, components,
        "number of {what} (left) and of components (right) differ"
    );
}

/// One value a component, each taken from its source, or `anew(i)`.
fn reindexed<T: Copy>(values: &[T], sources: &[u32], anew: impl Fn(usize) -> T) -> Vec<T> {
    let taken = |(i, &source): (usize, &u32)| match source {
        NEW_COMPONENT => anew(i),
        source => values[source as usize],
    };
    sources.iter().enumerate().map(taken).collect()
}
