//! From the commands of a flight to the orders of a vehicle that flies itself.

use tilthex_core::{
    Wrench,
    admittance::{AdmittanceFilter, AdmittanceParams},
    flight::Command,
    types::Matrix6,
};
use tilthex_link::onboard::{GoTo, Order, Part};

/// Turns commands into orders for the vehicle.
#[derive(Clone, Copy, Debug)]
pub struct Carrier {
    /// The configured admittance: its axes and limits cannot be changed.
    pub admittance: AdmittanceParams,
}

impl Carrier {
    /// The orders that carry out a command.
    ///
    /// # Errors
    /// Why the vehicle cannot get it, in words.
    pub fn orders(&self, command: &Command) -> Result<Vec<Order>, &'static str> {
        match command {
            Command::TakeOff => Ok(vec![Order::TakeOff]),
            Command::ZeroBias => Ok(vec![Order::ZeroBias]),
            Command::Play(route) => match route.waypoints() {
                [place] if place.wrench_w == Wrench::ZERO && !place.force_axes.any() => {
                    Ok(vec![Order::GoTo(GoTo {
                        position_w: place.position_w,
                        rotation_we: place.rotation_we,
                        duration: place.duration,
                        limits: *route.limits(),
                    })])
                }
                _ => Err("a vehicle that flies itself takes one way-point without a wrench at a time"),
            },
            Command::SetAdmittance(filter) => self.admittance(filter),
            Command::Follow(_) | Command::SetWrench(..) | Command::ReleaseWrench => {
                Err("a vehicle that flies itself takes no set-points and no wrenches from the console")
            }
        }
    }

    /// The orders that change the admittance.
    fn admittance(&self, filter: &AdmittanceFilter) -> Result<Vec<Order>, &'static str> {
        let params = filter.params();
        let parts = [
            (Part::Mass, &params.mass),
            (Part::Damping, &params.damping),
            (Part::Stiffness, &params.stiffness),
        ];
        let AdmittanceParams { mass, damping, stiffness, .. } = *params;
        if *params != (AdmittanceParams { mass, damping, stiffness, ..self.admittance })
            || parts.iter().any(|(_, matrix)| **matrix != Matrix6::from_diagonal(&matrix.diagonal()))
        {
            return Err("a vehicle that flies itself takes only diagonal mass, damping and stiffness");
        }
        Ok(parts.map(|(part, matrix)| Order::Admittance(part, matrix.diagonal())).into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tilthex_config::{Config, VehicleSection, orders::Orders};

    #[test]
    fn orders_that_the_vehicle_cannot_get_are_refused() {
        let config = Config::default_for(VehicleSection::preset("tilt-hex").expect("a preset"));
        let carrier = Carrier { admittance: config.controller().admittance };
        let place = r#"{"position": [0, 0, 1], "quaternion_xyzw": [0, 0, 0, 1]}"#;
        let turn = "[[1,0,0],[0,1,0],[0,0,1]]";
        for (line, count) in [
            (r#"{"command": "take_off"}"#.into(), Ok(1)),
            (r#"{"command": "zero_bias"}"#.into(), Ok(1)),
            (format!(r#"{{"command": "play", "waypoint": [{place}]}}"#), Ok(1)),
            (format!(r#"{{"command": "play", "waypoint": [{place}, {place}]}}"#), Err("one way-point")),
            (r#"{"command": "set_admittance", "stiffness": [9, 9, 9, 8, 8, 8]}"#.into(), Ok(3)),
            (r#"{"command": "set_admittance", "max_translation": 0.2}"#.into(), Err("only diagonal")),
            (
                format!(r#"{{"command": "follow", "position": [0, 0, 1], "rotation": {turn}}}"#),
                Err("no set-points"),
            ),
            (r#"{"command": "release_wrench"}"#.into(), Err("no wrenches")),
        ] {
            let command = Orders::new(&config).parse(&line).expect(&line);
            match (carrier.orders(&command), count) {
                (Ok(orders), Ok(count)) => assert_eq!(orders.len(), count, "{line}"),
                (Err(reason), Err(says)) => assert!(reason.contains(says), "{line}: {reason}"),
                (found, _) => panic!("{line}: {found:?}"),
            }
        }
    }
}
