//! Events of the plane sweep: where a plane that moves along an axis meets and
//! leaves the boxes of triangles.

use crate::Aabb;

/// References of one node, so many bits are left for their index in an event.
pub(super) const MAX_EVENT_REFERENCES: usize = 1 << INDEX_BITS;

const INDEX_BITS: u32 = 30;
const INDEX_MASK: u64 = (1 << INDEX_BITS) - 1;
const POSITION_SHIFT: u32 = 32;

/// What happens to a box at an event. At one position boxes end before they
/// start, so that neither counts for the side where it only touches the plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub(super) enum EventKind {
    /// The plane leaves the box.
    End = 0,
    /// The box lies in the plane.
    Planar = 1,
    /// The plane enters the box.
    Start = 2,
}

/// An event, packed so that its order (position, then kind, then reference) is
/// that of an integer: 32 bits of position, 2 of kind, 30 of reference.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct EdgeEvent(u64);

impl EdgeEvent {
    pub(super) fn new(position: f32, kind: EventKind, reference: u32) -> Self {
        debug_assert!((reference as usize) < MAX_EVENT_REFERENCES);
        // Adding 0 makes one zero of the two: events at either stand at one position.
        let bits = (position + 0.0).to_bits();
        // Positive numbers are ordered as their bits are, negative ones the other way round.
        let flip = if bits >> 31 == 0 { 1 << 31 } else { u32::MAX };
        Self(
            u64::from(bits ^ flip) << POSITION_SHIFT
                | (kind as u64) << INDEX_BITS
                | u64::from(reference),
        )
    }

    /// The events of a box on one axis, in order: one if it is flat, else two.
    pub(super) fn of_box(
        bounds: &Aabb,
        axis: usize,
        reference: u32,
    ) -> impl Iterator<Item = Self> + use<> {
        let (min, max) = (bounds.min[axis], bounds.max[axis]);
        let (first, last) = if min == max {
            (EventKind::Planar, None)
        } else {
            let end = Self::new(max, EventKind::End, reference);
            (EventKind::Start, Some(end))
        };
        std::iter::once(Self::new(min, first, reference)).chain(last)
    }

    pub(super) fn position(self) -> f32 {
        let key = (self.0 >> POSITION_SHIFT) as u32;
        let flip = if key >> 31 == 1 { 1 << 31 } else { u32::MAX };
        f32::from_bits(key ^ flip)
    }

    pub(super) fn kind(self) -> EventKind {
        match (self.0 >> INDEX_BITS) & 3 {
            0 => EventKind::End,
            1 => EventKind::Planar,
            _ => EventKind::Start,
        }
    }

    /// Index of the triangle's reference in its node.
    pub(super) fn reference(self) -> usize {
        (self.0 & INDEX_MASK) as usize
    }

    /// The same event of a reference that has moved to another index.
    pub(super) fn with_reference(self, reference: u32) -> Self {
        Self(self.0 & !INDEX_MASK | u64::from(reference))
    }

    pub(super) fn same_position(self, other: Self) -> bool {
        (self.0 ^ other.0) >> POSITION_SHIFT == 0
    }
}

impl std::fmt::Debug for EdgeEvent {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{:?} of {} at {:?}",
            self.kind(),
            self.reference(),
            self.position()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn order_is_position_then_kind_then_reference() {
        use EventKind::*;
        let ordered = [
            EdgeEvent::new(-1e12, Start, 9),
            EdgeEvent::new(-2.0, Start, 9),
            EdgeEvent::new(-f32::from_bits(1), Start, 9),
            EdgeEvent::new(0.0, End, 3),
            EdgeEvent::new(-0.0, Planar, 2),
            EdgeEvent::new(0.0, Start, 1),
            EdgeEvent::new(-0.0, Start, 2),
            EdgeEvent::new(f32::from_bits(1), End, 0),
            EdgeEvent::new(1e12, End, 0),
        ];
        assert!(ordered.is_sorted_by(|a, b| a < b));
    }

    #[test]
    fn fields_come_back() {
        for position in [-1e12, -1.5, 0.0, 1e-40, 3.25, 1e12_f32] {
            for kind in [EventKind::End, EventKind::Planar, EventKind::Start] {
                for reference in [0, 77, (MAX_EVENT_REFERENCES - 1) as u32] {
                    let event = EdgeEvent::new(position, kind, reference);
                    assert_eq!(event.position().to_bits(), position.to_bits());
                    assert_eq!(
                        (event.kind(), event.reference()),
                        (kind, reference as usize)
                    );
                    assert!(event.same_position(event.with_reference(5)));
                    assert_eq!(event.with_reference(5).reference(), 5);
                }
            }
        }
    }

    #[test]
    fn a_box_between_the_two_zeros_is_planar() {
        let bounds = Aabb {
            min: [-0.0; 3],
            max: [0.0; 3],
        };
        let events: Vec<_> = EdgeEvent::of_box(&bounds, 1, 4).collect();
        assert_eq!(events, [EdgeEvent::new(0.0, EventKind::Planar, 4)]);
    }
}
