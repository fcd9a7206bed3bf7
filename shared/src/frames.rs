//! Typed frames: a vector, point or rotation carries its frame, and mixing frames does not compile.
//!
//! World frames are north, east, down about an origin ([`Datum`]): [`VesselNed`] at the vessel's first GNSS
//! fix and [`DroneNed`] at the origin of the drone's autopilot, each displaced by its own GNSS error of a
//! metre or more, and [`TrueNed`] in the simulated world only. Body frames are FRD (forward, right, down).
//!
//! ```compile_fail
//! use alight_shared::frames::{Vector, VesselNed, DroneNed};
//! let wrong = Vector::<VesselNed>::new(1.0, 0.0, 0.0) + Vector::<DroneNed>::new(1.0, 0.0, 0.0);
//! ```

use core::{
    fmt,
    marker::PhantomData,
    ops::{Add, Mul, Neg, Sub},
};

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Coordinate frame.
pub trait Frame: Copy + PartialEq + 'static {
    /// Name used in messages.
    const NAME: &'static str;
}

macro_rules! frames {
    ($($(#[$doc:meta])* $name:ident = $text:literal;)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name;
        impl Frame for $name { const NAME: &'static str = $text; }
    )*};
}
frames! {
    /// NED about the vessel's datum, by its GNSS.
    VesselNed = "vessel NED";
    /// NED about the autopilot's origin, by its navigation.
    DroneNed = "drone NED";
    /// The simulated world's NED tangent plane.
    TrueNed = "true NED";
    /// The vessel's body, FRD, origin at its reference point (midships on the waterline at rest).
    VesselBody = "vessel FRD";
    /// Vessel-parallel frame: horizontal, rotated by the heading, origin as above (Fossen 2011, 7.5.3).
    VesselParallel = "vessel-parallel";
    /// The landing deck, FRD, origin at the centre of its upper surface.
    Deck = "deck FRD";
    /// The drone's body, FRD, origin at its centre of mass.
    DroneBody = "drone FRD";
    /// The camera: x right in the image, y down in the image, z along the optical axis.
    Camera = "camera RDF";
    /// The fiducial tag: axes parallel to the deck's FRD, origin at the tag's centre.
    Tag = "tag FRD";
}

/// Free vector in frame `F` (displacement, velocity, acceleration, rate, force), SI units.
#[derive(Clone, Copy, PartialEq)]
pub struct Vector<F>(pub Vector3<f64>, PhantomData<fn() -> F>);
/// Position in frame `F`, m.
#[derive(Clone, Copy, PartialEq)]
pub struct Point<F>(pub Vector3<f64>, PhantomData<fn() -> F>);
/// Rotation that maps coordinates in `From` to coordinates in `To`: `v_to = R v_from`.
#[derive(Clone, Copy, PartialEq)]
pub struct Rotation<To, From>(pub UnitQuaternion<f64>, PhantomData<fn() -> (To, From)>);

impl<F> Vector<F> {
    /// Vector from components.
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Vector(Vector3::new(x, y, z), PhantomData)
    }
    /// Vector from bare components; the caller guarantees their frame.
    pub const fn from(v: Vector3<f64>) -> Self {
        Vector(v, PhantomData)
    }
    /// The zero vector.
    pub const fn zero() -> Self {
        Self::new(0.0, 0.0, 0.0)
    }
    /// Euclidean norm.
    pub fn norm(&self) -> f64 {
        self.0.norm()
    }
    /// Inner product.
    pub fn dot(&self, o: &Self) -> f64 {
        self.0.dot(&o.0)
    }
    /// Cross product.
    pub fn cross(&self, o: &Self) -> Self {
        Self::from(self.0.cross(&o.0))
    }
}
impl<F> Point<F> {
    /// Point from components, m.
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Point(Vector3::new(x, y, z), PhantomData)
    }
    /// Point from bare coordinates; the caller guarantees their frame.
    pub const fn from(v: Vector3<f64>) -> Self {
        Point(v, PhantomData)
    }
    /// Origin of the frame.
    pub const fn origin() -> Self {
        Self::new(0.0, 0.0, 0.0)
    }
}
impl<To, From> Rotation<To, From> {
    /// Rotation from a bare quaternion; the caller guarantees its frames.
    pub const fn from(q: UnitQuaternion<f64>) -> Self {
        Rotation(q, PhantomData)
    }
    /// Identity, for parallel frames.
    pub fn identity() -> Self {
        Self::from(UnitQuaternion::identity())
    }
    /// Rotation from ZYX Euler angles (Fossen 2011, eq. 2.18): `R = Rz(yaw) Ry(pitch) Rx(roll)`, rad.
    pub fn from_euler(roll: f64, pitch: f64, yaw: f64) -> Self {
        Self::from(UnitQuaternion::from_euler_angles(roll, pitch, yaw))
    }
    /// ZYX Euler angles (roll, pitch, yaw), rad.
    pub fn euler(&self) -> (f64, f64, f64) {
        self.0.euler_angles()
    }
    /// Inverse rotation.
    pub fn inverse(&self) -> Rotation<From, To> {
        Rotation::from(self.0.inverse())
    }
    /// Image of `From`'s down axis, e.g. the viewing direction of a downward camera.
    pub fn down(&self) -> Vector<To> {
        Vector::from(self.0 * Vector3::z())
    }
}

macro_rules! debug {
    ($($type:ident $open:literal $close:literal;)*) => {$(
        impl<F: Frame> fmt::Debug for $type<F> {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                let v = &self.0;
                write!(f, "{}{:.4} {:.4} {:.4}{} in {}", $open, v.x, v.y, v.z, $close, F::NAME)
            }
        }
    )*};
}
debug! {
    Vector "[" "]";
    Point "(" ")";
}
impl<A: Frame, B: Frame> fmt::Debug for Rotation<A, B> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (r, p, y) = self.euler();
        write!(
            f,
            "{} from {}: roll {r:.4} pitch {p:.4} yaw {y:.4} rad",
            A::NAME,
            B::NAME
        )
    }
}

macro_rules! operators {
    ($($left:ident $trait:ident $method:ident $right:ident = $out:ident;)*) => {$(
        impl<F> $trait<$right<F>> for $left<F> {
            type Output = $out<F>;
            fn $method(self, o: $right<F>) -> $out<F> {
                $out::from(self.0.$method(o.0))
            }
        }
    )*};
}
operators! {
    Vector Add add Vector = Vector;
    Vector Sub sub Vector = Vector;
    Point Sub sub Point = Vector;
    Point Add add Vector = Point;
    Point Sub sub Vector = Point;
}
impl<F> Neg for Vector<F> {
    type Output = Self;
    fn neg(self) -> Self {
        Self::from(-self.0)
    }
}
impl<F> Mul<f64> for Vector<F> {
    type Output = Self;
    fn mul(self, k: f64) -> Self {
        Self::from(self.0 * k)
    }
}
impl<A, B> Mul<Vector<B>> for Rotation<A, B> {
    type Output = Vector<A>;
    fn mul(self, v: Vector<B>) -> Vector<A> {
        Vector::from(self.0 * v.0)
    }
}
impl<A, B, C> Mul<Rotation<B, C>> for Rotation<A, B> {
    type Output = Rotation<A, C>;
    fn mul(self, o: Rotation<B, C>) -> Rotation<A, C> {
        Rotation::from(self.0 * o.0)
    }
}

/// Rotation from a downward camera with aligned axes to the body: camera x, y, z are body y, -x, z.
pub fn body_from_camera() -> Matrix3<f64> {
    Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
}

/// Rotation by `yaw` about the down axis, rad.
pub fn yaw_rotation(yaw: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(0.0, 0.0, yaw)
}

/// Components of a rotation as messages carry them: w, x, y, z.
pub fn wxyz(q: &UnitQuaternion<f64>) -> [f64; 4] {
    [q.w, q.i, q.j, q.k]
}

/// Wraps an angle to (-pi, pi], rad. A non-finite angle stays non-finite.
pub fn wrap_angle(a: f64) -> f64 {
    use core::f64::consts::{PI, TAU};
    let w = (a + PI).rem_euclid(TAU) - PI;
    if w <= -PI { PI } else { w }
}

/// Euler-angle rates from body rates: `T(phi, theta)` of Fossen 2011, eq. 2.28 (rad/s); cos(pitch) >= 1e-3.
pub fn euler_rates(roll: f64, pitch: f64, body: Vector3<f64>) -> Vector3<f64> {
    let (sr, cr) = roll.sin_cos();
    let cp = if pitch.cos().abs() < 1e-3 {
        1e-3
    } else {
        pitch.cos()
    };
    let tp = pitch.sin() / cp;
    Vector3::new(
        body.x + sr * tp * body.y + cr * tp * body.z,
        cr * body.y - sr * body.z,
        (sr * body.y + cr * body.z) / cp,
    )
}

/// Body rates from Euler-angle rates, the inverse of [`euler_rates`] (rad/s).
pub fn body_rates(roll: f64, pitch: f64, euler: Vector3<f64>) -> Vector3<f64> {
    let (sr, cr) = roll.sin_cos();
    let (sp, cp) = pitch.sin_cos();
    Vector3::new(
        euler.x - sp * euler.z,
        cr * euler.y + sr * cp * euler.z,
        -sr * euler.y + cr * cp * euler.z,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn euler_and_body_rates_inverse() {
        let e = Vector3::new(0.3, -0.2, 0.5);
        let back = euler_rates(0.4, -0.3, body_rates(0.4, -0.3, e));
        assert!((back - e).norm() < 1e-12);
    }

    #[test]
    fn rotation_from_second_to_first_frame() {
        // With the vessel heading east, the bow points east.
        let r = Rotation::<VesselNed, VesselBody>::from_euler(0.0, 0.0, core::f64::consts::FRAC_PI_2);
        let bow = r * Vector::new(1.0, 0.0, 0.0);
        assert!((bow.0 - Vector3::new(0.0, 1.0, 0.0)).norm() < 1e-12);
        // Positive pitch raises the bow: it points towards negative down.
        let up = Rotation::<VesselNed, VesselBody>::from_euler(0.0, 0.1, 0.0) * Vector::new(1.0, 0.0, 0.0);
        assert!(up.0.z < 0.0);
    }

    #[test]
    fn angle_wrap_half_open_interval() {
        use core::f64::consts::PI;
        assert!((wrap_angle(3.0 * PI) - PI).abs() < 1e-12);
        assert!((wrap_angle(-PI) - PI).abs() < 1e-12);
        assert!((wrap_angle(0.1) - 0.1).abs() < 1e-15);
        assert!(wrap_angle(f64::NAN).is_nan());
    }
}
