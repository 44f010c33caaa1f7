//! The sections of the controller's blocks.

use super::{
    LinkSection,
    margins::LoopModel,
    section::{self, ConfigError, Section, section},
    values::{Axes, Square},
};
use tilthex_core::{
    Vector3, Vehicle,
    admittance::{AdmittanceFilter, AdmittanceParams, Axes as FilterAxes},
    allocation::{Allocator, AllocatorParams, Priority},
    attitude::{AttitudeMode, AttitudeParams, AttitudeSelector},
    contact::{ContactParams, WindWalk},
    controller::{Controller, ControllerParams},
    free_wrench::FreeWrenchParams,
    plant::{BodyDrag, RotorDrag},
    pose_control::{PoseController, PoseGains},
    reach::Reach,
    reference_bounds::ReferenceBounds,
    vehicle::Actuation,
    wrench_observer::{ObserverGains, WrenchObserver},
};
use toml::Table;

section! {
    /// The pose controller, (14) and (17). Each gain is one number, or one number for each axis. If the rotors' lag or the
    /// link's delay leave the default gains too little margin, the gains are derived (docs/stability.md).
    pub PoseControlSection as "pose_control" {
        /// K_p2, on the position error, world axes.
        position_gain: Axes<3> = Axes([100.0; 3]) => "1/s^2" from 0.0 to 1e5,
        /// K_p1, on the velocity error, world axes.
        velocity_gain: Axes<3> = Axes([20.0; 3]) => "1/s" from 0.0 to 1e5,
        /// K_R2, on the rotation error, robot axes.
        rotation_gain: Axes<3> = Axes([225.0; 3]) => "1/s^2" from 0.0 to 1e5,
        /// K_R1, on the angular velocity error, robot axes.
        angular_velocity_gain: Axes<3> = Axes([30.0; 3]) => "1/s" from 0.0 to 1e5,
    }
}

section! {
    /// The wrench observer, (19) and (21). Each gain is one number, or one number for each axis. If the rotors' lag or the
    /// link's delay leave the default gains too little margin, the gains are derived (docs/stability.md).
    pub WrenchObserverSection as "wrench_observer" {
        /// L: rate at which the force estimate follows, world axes.
        force_gain: Axes<3> = Axes([30.0; 3]) => "1/s" from 1e-6 to 1e5,
        /// K_I: rate at which the torque estimate follows, robot axes.
        torque_gain: Axes<3> = Axes([30.0; 3]) => "1/s" from 1e-6 to 1e5,
    }
}

section! {
    /// The admittance filter at the tool, (27), translation before rotation, in the axes that `axes` names. Each matrix:
    /// its six diagonal numbers, or 6x6.
    pub AdmittanceSection as "admittance" {
        /// "world", or "tool": those of the tool at its set-point.
        axes: String = FilterAxes::default().name().into(),
        /// M_E.
        mass: Square<6> = Square(AdmittanceParams::default().mass) => "kg and kg m^2" by "set_admittance",
        /// D_E.
        damping: Square<6> = Square(AdmittanceParams::default().damping) => "N s/m and N m s/rad" by "set_admittance",
        /// K_E. The rotational spring has a potential if no rotational stiffness is larger than the sum of the two others.
        stiffness: Square<6> = Square(AdmittanceParams::default().stiffness) => "N/m and N m/rad" by "set_admittance",
        /// Tool forces up to this norm do not move the reference.
        force_dead_zone: f64 = 0.2 => "N" from 0.0 to 100.0,
        /// Tool torques up to this norm do not turn the reference.
        torque_dead_zone: f64 = 0.2 => "N m" from 0.0 to 100.0,
        /// Cut-off of the low-pass before the dead zones; 0 for none.
        low_pass_hz: f64 = 20.0 => "Hz" from 0.0 to 1e6,
        /// For a tool whose rotation about its own axis (z) does not matter: the largest torque that turns the
        /// reference about this axis towards attitudes in which the rotors have more room in a hover; 0 for none.
        room_torque: f64 = 0.0 => "N m" from 0.0 to 1000.0,
        /// Largest speed to which a wrench set-point drives the tool if nothing resists it.
        max_wrench_speed: f64 = FreeWrenchParams::default().speed => "m/s" from 1e-3 to 10.0,
        /// Largest distance by which a wrench set-point moves the tool if nothing resists it.
        max_wrench_way: f64 = FreeWrenchParams::default().way => "m" from 0.0 to 100.0,
        /// Largest angular velocity to which a wrench set-point drives the tool if nothing resists it.
        max_wrench_spin_deg: f64 = 30.0 => "degrees/s" from 0.1 to 1e3,
        /// Largest angle by which a wrench set-point turns the tool if nothing resists it.
        max_wrench_turn_deg: f64 = 30.0 => "degrees" from 0.0 to 177.0,
        /// Largest distance of the reference from the set-point.
        max_translation: f64 = AdmittanceParams::default().max_translation => "m" from 0.0 to 100.0 by "set_admittance",
        /// Largest rotation of the reference from the set-point.
        max_rotation_deg: f64 = 60.0 => "degrees" from 0.0 to 177.0 by "set_admittance",
        /// Largest speed of the reference relative to its set-point, for example after a loss of contact.
        max_velocity: f64 = ReferenceBounds::default().speed => "m/s" from 1e-3 to 100.0,
        /// Largest angular velocity of the reference relative to its set-point.
        max_angular_velocity_deg: f64 = 180.0 => "degrees/s" from 0.1 to 5000.0,
        /// Energy that the reference may put into what the tool touches, beside `tank_power`.
        tank_capacity: f64 = ReferenceBounds::default().capacity => "J" from 0.0 to 1e4,
        /// Power that the reference may put into what the tool touches all the time.
        tank_power: f64 = ReferenceBounds::default().power => "W" from 0.0 to 1e4,
    }
}

section! {
    /// Tells wind from contact: the part of the observed wrench that is drag in a wind does not move the tool (docs/contact.md).
    pub ContactSection as "contact" {
        /// Whether the drag of a wind is separated from contact. If not, the whole observed wrench moves the tool.
        discrimination: bool = false,
        /// Drag of the rotors in the model: force against the airspeed in a rotor's disc, per Hz of its speed. If it is not set, that
        /// of `[vehicle]`.
        rotor_drag: Option<f64> = None => "N s/m per Hz" from 0.0 to 1.0,
        /// Flapping of the rotors in the model: torque that lifts the leading edge of a rotor's disc. If it is not set, that of `[vehicle]`.
        flapping: Option<f64> = None => "N m s/m per Hz" from -1.0 to 1.0,
        /// Drag coefficient times area of the airframe along robot x, y, z: force 1/2 rho C A |v| v.
        drag_area: Axes<3> = Axes([0.0; 3]) => "m^2" from 0.0 to 10.0,
        /// Point at which that force acts, from the centre of mass, robot frame.
        centre_of_pressure: Axes<3> = Axes([0.0; 3]) => "m" from -10.0 to 10.0,
        /// Standard deviation of each horizontal component of the wind.
        wind_deviation: f64 = WindWalk::DEFAULT.horizontal => "m/s" from 1e-3 to 50.0,
        /// Standard deviation of the vertical component of the wind, and of the gusts in every direction. With a large one, a steady vertical touch becomes wind in time.
        vertical_wind_deviation: f64 = WindWalk::DEFAULT.vertical => "m/s" from 1e-3 to 50.0,
        /// Time in which the wind changes by these deviations.
        wind_time: f64 = WindWalk::DEFAULT.time => "s" from 0.1 to 1e4,
        /// Standard deviation of the force that is observed without wind and contact.
        force_noise: f64 = ContactParams::default().noise.0 => "N" from 1e-3 to 10.0,
        /// Standard deviation of the torque about the tool that is observed without wind and contact.
        torque_noise: f64 = ContactParams::default().noise.1 => "N m" from 1e-4 to 10.0,
        /// Size of the force of a touch.
        touch_force: f64 = ContactParams::default().touch.0 => "N" from 1e-3 to 100.0,
        /// Size of the torque of a touch about the tool. A touch at the tip has none.
        touch_torque: f64 = ContactParams::default().touch.1 => "N m" from 1e-3 to 100.0,
        /// Whether touches are at the tip of the tool only, without a torque about it (no peg, no gripper). Gusts are then seen during a touch.
        point_contact: bool = false,
    }
}

section! {
    /// The allocation of the wanted wrench to the rotors within their limits, (12).
    pub AllocationSection as "allocation" {
        /// Order in which the parts of the wrench are kept if the limits do not allow all of them, most important
        /// first.
        order: Vec<String> = Priority::ORDER.map(|p| p.name().into()).to_vec(),
        /// Speeds are limited to those that the rotors can reach within this time in spite of their lag; 0 for no
        /// such limit.
        horizon: f64 = 0.0 => "s" from 0.0 to 10.0,
    }
}

section! {
    /// The attitude of the vehicle if the lateral force does not suffice (Franchi et al. 2018).
    pub AttitudeSection as "attitude" {
        /// "full": the reference's, turned if the force needs it; "minimal-tilt": level with the reference's heading, turned
        /// if the force needs it; "zero-tilt": always level; "fixed-tilt": always the reference's.
        mode: String = AttitudeMode::default().name().into(),
        /// Part of each rotor's input range, at either end, that a hover keeps free for torques.
        reserve: f64 = AttitudeParams::default().reserve => "1" from 0.0 to 0.45,
        /// Largest turn for horizontal force, from the hover attitude that is nearest to the wanted attitude. Force
        /// that needs a larger turn is given up.
        max_turn_deg: f64 = 35.0 => "degrees" from 0.0 to 85.9,
        /// Bandwidth of the turn's filter: a small turn takes about 2 divided by this. A large turn takes longer,
        /// because of the rotors.
        bandwidth: f64 = AttitudeParams::default().bandwidth => "rad/s" from 0.1 to 500.0,
    }
}

impl PoseControlSection {
    fn gains(&self) -> PoseGains {
        PoseGains {
            position: self.position_gain.vector(),
            velocity: self.velocity_gain.vector(),
            rotation: self.rotation_gain.vector(),
            angular_velocity: self.angular_velocity_gain.vector(),
        }
    }
}

impl WrenchObserverSection {
    fn gains(&self) -> ObserverGains {
        ObserverGains { force: self.force_gain.vector(), torque: self.torque_gain.vector() }
    }
}

impl AdmittanceSection {
    /// The filter's parameters.
    pub(super) fn params(&self) -> Result<AdmittanceParams, ConfigError> {
        let place = format!("[{}] axes", Self::NAME);
        let axes = FilterAxes::ALL.into_iter();
        section::check_known("axes", &self.axes, axes.clone().map(FilterAxes::name))
            .map_err(|e| e.within(&place))?;
        Ok(AdmittanceParams {
            axes: axes.into_iter().find(|a| a.name() == self.axes).unwrap_or_default(),
            mass: self.mass.0,
            damping: self.damping.0,
            stiffness: self.stiffness.0,
            max_translation: self.max_translation,
            max_rotation: self.max_rotation_deg.to_radians(),
        })
    }
}

impl AdmittanceSection {
    fn free_wrench(&self) -> FreeWrenchParams {
        FreeWrenchParams {
            speed: self.max_wrench_speed,
            way: self.max_wrench_way,
            spin: self.max_wrench_spin_deg.to_radians(),
            turn: self.max_wrench_turn_deg.to_radians(),
        }
    }
}

impl AdmittanceSection {
    fn bounds(&self) -> ReferenceBounds {
        ReferenceBounds {
            speed: self.max_velocity,
            spin: self.max_angular_velocity_deg.to_radians(),
            capacity: self.tank_capacity,
            power: self.tank_power,
        }
    }
}

impl ContactSection {
    /// With the gains of the observer whose wrench is looked at, and the drag of the vehicle's rotors.
    fn params(&self, observer: &ObserverGains, rotors: RotorDrag) -> ContactParams {
        ContactParams {
            discrimination: self.discrimination,
            rotor_drag: RotorDrag {
                drag: self.rotor_drag.unwrap_or(rotors.drag),
                flapping: self.flapping.unwrap_or(rotors.flapping),
            },
            body_drag: BodyDrag {
                area_r: self.drag_area.vector(),
                centre_r: self.centre_of_pressure.vector(),
            },
            wind: WindWalk {
                horizontal: self.wind_deviation,
                vertical: self.vertical_wind_deviation,
                time: self.wind_time,
            },
            noise: (self.force_noise, self.torque_noise),
            touch: (self.touch_force, self.touch_torque),
            point_contact: self.point_contact,
            rate: observer.force.min().min(observer.torque.min()),
            ..ContactParams::default()
        }
    }
}

impl AllocationSection {
    fn params(&self) -> Result<AllocatorParams, ConfigError> {
        let count = Priority::ORDER.len();
        let place = format!("[{}] order", Self::NAME);
        let parts = self.order.iter().map(|name| {
            let known = Priority::ORDER.iter().map(|p| p.name());
            section::check_known("part", name, known).map_err(|e| e.within(&place))?;
            Priority::from_name(name).ok_or_else(|| ConfigError::new(name.as_str()))
        });
        let parts = parts.collect::<Result<Vec<_>, _>>()?;
        let order = parts.try_into().map_err(|parts: Vec<_>| {
            ConfigError::new(format!("{place}: found {} parts, expected each of {count} once", parts.len()))
        })?;
        Ok(AllocatorParams { order, horizon: self.horizon })
    }
}

impl AttitudeSection {
    fn params(&self) -> Result<AttitudeParams, ConfigError> {
        let place = format!("[{}] mode", Self::NAME);
        section::check_known("attitude", &self.mode, AttitudeMode::ALL.iter().map(|m| m.name()))
            .map_err(|e| e.within(&place))?;
        Ok(AttitudeParams {
            mode: AttitudeMode::from_name(&self.mode).unwrap_or_default(),
            reserve: self.reserve,
            max_turn: self.max_turn_deg.to_radians(),
            bandwidth: self.bandwidth,
        })
    }
}

/// Defaults that depend on the vehicle. If it moves sideways only by tilting, the attitude must change before a lateral force
/// acts: the position loop, and the observer whose estimate it compensates, must be slower, and the vehicle may turn further.
/// The largest forces and torques are those that the vehicle can exert. If rotors or link (in `given`) are so slow that
/// these gains leave little margin, the gains are derived from the vehicle.
pub(super) fn defaults(vehicle: &Vehicle, given: &Table) -> Result<Table, ConfigError> {
    let reach = Reach::of(vehicle, 0.0);
    // In tenths, within what the section takes.
    let rounded = |found: f64, least: f64| ((10.0 * found).round() / 10.0).max(least);
    let (force, torque) = (rounded(reach.largest_force(), 1.0), rounded(reach.largest_torque(), 0.1));
    let tilts = vehicle.actuation() != Actuation::Pose;
    let mut params = default_params()?;
    if tilts {
        params.pose.position = Vector3::repeat(5.0);
        params.pose.velocity = Vector3::repeat(5.0);
    }
    // Errors of `[link]` are reported where the section is read.
    let link = given.get("link").and_then(toml::Value::as_table);
    let link: LinkSection = link.and_then(|table| section::read(table).ok()).unwrap_or_default();
    let model = LoopModel::new(params, vehicle, vehicle, link.loop_delays());
    let gains = match (model.is_sound(), tilts) {
        (true, false) => String::new(),
        (true, true) => "pose_control = { position_gain = 5.0, velocity_gain = 5.0 }\n\
                         wrench_observer = { force_gain = 4.0 }\n"
            .into(),
        (false, _) => model.derive().to_toml(),
    };
    let turn = if tilts { "attitude = { max_turn_deg = 45.0 }\n" } else { "" };
    super::parse(&format!("{gains}{turn}supervisor = {{ max_force = {force:?}, max_torque = {torque:?} }}\n"))
}

fn default_params() -> Result<ControllerParams, ConfigError> {
    ControllerSections {
        pose: &PoseControlSection::default(),
        observer: &WrenchObserverSection::default(),
        admittance: &AdmittanceSection::default(),
        contact: &ContactSection::default(),
        allocation: &AllocationSection::default(),
        attitude: &AttitudeSection::default(),
        rotor_drag: RotorDrag::default(),
    }
    .params()
}

/// The sections that make the controller.
pub(super) struct ControllerSections<'a> {
    pub(super) pose: &'a PoseControlSection,
    pub(super) observer: &'a WrenchObserverSection,
    pub(super) admittance: &'a AdmittanceSection,
    pub(super) contact: &'a ContactSection,
    pub(super) allocation: &'a AllocationSection,
    pub(super) attitude: &'a AttitudeSection,
    /// That of the vehicle.
    pub(super) rotor_drag: RotorDrag,
}

impl ControllerSections<'_> {
    fn params(&self) -> Result<ControllerParams, ConfigError> {
        Ok(ControllerParams {
            pose: self.pose.gains(),
            observer: self.observer.gains(),
            admittance: self.admittance.params()?,
            force_dead_zone: self.admittance.force_dead_zone,
            torque_dead_zone: self.admittance.torque_dead_zone,
            low_pass_hz: self.admittance.low_pass_hz,
            room_torque: self.admittance.room_torque,
            contact: self.contact.params(&self.observer.gains(), self.rotor_drag),
            free_wrench: self.admittance.free_wrench(),
            bounds: self.admittance.bounds(),
            allocation: self.allocation.params()?,
            attitude: self.attitude.params()?,
        })
    }

    /// The controller's parameters, checked block by block so that an error names its section.
    pub(super) fn checked(&self, vehicle: &Vehicle) -> Result<ControllerParams, ConfigError> {
        fn within<S: Section>(error: tilthex_core::Error) -> ConfigError {
            ConfigError::from(error).within(format_args!("[{}]", S::NAME))
        }
        let params = self.params()?;
        PoseController::new(params.pose).map_err(within::<PoseControlSection>)?;
        WrenchObserver::new(vehicle, params.observer).map_err(within::<WrenchObserverSection>)?;
        AdmittanceFilter::new(params.admittance).map_err(within::<AdmittanceSection>)?;
        params.contact.checked().map_err(within::<ContactSection>)?;
        AttitudeSelector::new(vehicle, params.attitude).map_err(within::<AttitudeSection>)?;
        Allocator::with_params(vehicle, params.allocation).map_err(within::<AllocationSection>)?;
        // What is left to refuse is the filter, the dead zones and the torque towards more room.
        Controller::new(*vehicle, params).map_err(within::<AdmittanceSection>)?;
        Ok(params)
    }
}

/// What a rotational spring without a potential means.
pub(super) fn spring_warning(params: &ControllerParams) -> Option<String> {
    let filter = AdmittanceFilter::new(params.admittance).ok()?;
    let k = params.admittance.stiffness;
    (!filter.has_potential()).then(|| {
        format!(
            "[{}] stiffness: the rotational part, of diagonal {}, {} and {} N m/rad, has no potential: a tool that is led \
             around gains energy from it; expected each at most the sum of the two others",
            AdmittanceSection::NAME,
            k[(3, 3)],
            k[(4, 4)],
            k[(5, 5)]
        )
    })
}
