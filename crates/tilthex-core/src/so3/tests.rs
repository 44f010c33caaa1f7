use super::*;
use core::f64::consts::PI;
use proptest::prelude::*;

fn unit() -> impl Strategy<Value = Vector3> {
    prop::array::uniform3(-1.0..1.0f64)
        .prop_map(Vector3::from)
        .prop_filter("not too short", |v| v.norm() > 0.1)
        .prop_map(|v| v.normalize())
}

/// Angles where the maps change their form, and everything between.
fn angles() -> impl Strategy<Value = f64> {
    prop_oneof![
        0.0..PI,
        (-18.0..0.0f64).prop_map(|e| libm::pow(10.0, e)),
        (-18.0..0.0f64).prop_map(|e| PI - libm::pow(10.0, e)),
    ]
}

proptest! {
    #[test]
    fn exp_is_a_rotation(a in unit(), t in angles()) {
        prop_assert!(rotation_defect(&exp(&(t * a))) < 1e-14);
    }

    #[test]
    fn log_inverts_exp(a in unit(), t in angles()) {
        let v = t * a;
        let back = log(&exp(&v));
        // At pi itself -v is the same rotation.
        let distance = (back - v).norm().min(if PI - t < 1e-7 { (back + v).norm() } else { 9.0 });
        prop_assert!(distance < 1e-12, "{distance:e}");
    }

    #[test]
    fn exp_inverts_log(a in unit(), t in angles()) {
        let r = exp(&(t * a));
        prop_assert!((exp(&log(&r)) - r).amax() < 1e-12);
    }

    #[test]
    fn jacobian_has_its_inverse(a in unit(), t in angles(), d in unit()) {
        let v = t * a;
        prop_assert!((left_jacobian(&v) * left_jacobian_solve(&v, &d) - d).amax() < 1e-12);
    }

    #[test]
    fn jacobian_is_the_derivative(a in unit(), t in 0.0..3.0f64, b in unit()) {
        let (v, d) = (t * a, 1e-6 * b);
        let moved = exp(&(v + left_jacobian_solve(&v, &d)));
        prop_assert!((moved - exp(&d) * exp(&v)).amax() < 1e-10);
    }

    #[test]
    fn projection_finds_the_rotation(a in unit(), t in angles(), scale in 0.5..2.0f64) {
        let r = exp(&(t * a));
        let found = project(&(scale * r)).unwrap();
        prop_assert!((found - r).amax() < 1e-12);
    }

    #[test]
    fn rounding_errors_are_removed(a in unit(), t in angles(), errors in prop::array::uniform9(-1e-7..1e-7f64)) {
        let r = exp(&(t * a));
        let found = unrounded(&(r + Matrix3::from_row_slice(&errors)));
        prop_assert!(rotation_defect(&found) < 1e-12);
        prop_assert!((found - r).amax() < 1e-6);
    }

    #[test]
    fn quaternion_round_trip(a in unit(), t in angles()) {
        let r = exp(&(t * a));
        let back = from_quaternion_xyzw(to_quaternion_xyzw(&r)).unwrap();
        prop_assert!((back - r).amax() < 1e-12);
    }

    #[test]
    fn vee_inverts_hat(a in unit(), b in unit()) {
        prop_assert_eq!(vee(&hat(&a)), a);
        prop_assert!((hat(&a) * b - a.cross(&b)).amax() < 1e-15);
    }
}

#[test]
fn a_reflection_is_no_rotation() {
    assert!(project(&-Matrix3::identity()).is_none());
    assert!(project(&Matrix3::zeros()).is_none());
    assert!(check_rotation("r", &-Matrix3::identity()).is_err());
    let mut r = Matrix3::identity();
    r[(0, 0)] = f64::NAN;
    assert_eq!(check_rotation("r", &r), Err(Error::NotFinite { name: "r" }));
}
