//! What must not hurt the people beside a vehicle: whole flights through the link, on virtual time, each with
//! something that real peers and people do, and the end that it must have.

#![allow(clippy::unwrap_used)]

mod bias;
mod capture;
mod landing;
mod lift_off;
mod line;
mod motors;
mod orders;
mod rig;
mod rotors;
mod world;
