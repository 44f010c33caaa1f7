/* tilthex in C: control of fully actuated multirotors as flying end-effectors.
 *
 * Units are SI; rotor speeds are in Hz. The world's z axis points up. Suffixes name the coordinates: _w world, _r robot
 * (origin in the centre of mass), _e tool, _i inertial sensor, _c captured body. A rotation `rotation_ab` maps b to a
 * coordinates; matrices are [row][column]. External wrenches are those that the environment exerts on the robot.
 *
 * A block (TilthexController, ...) is a struct that the caller owns; only the functions read its words. An init function
 * checks and fills it, a step function changes it. Nothing is allocated, and no function keeps a pointer. Each pointer is
 * null or points to a valid object. Blocks in different threads do not disturb each other.
 *
 * Written by cbindgen from the sources of crates/tilthex-c; docs/howto/c.md shows how to use it. */

#ifndef TILTHEX_H
#define TILTHEX_H

#include <stdint.h>

// Bytes of a message, with its zero byte.
#define TILTHEX_MESSAGE_LENGTH 400

// Words of 8 bytes of a `TilthexObserver`.
#define TILTHEX_OBSERVER_WORDS 160

// Words of 8 bytes of a `TilthexAdmittance`.
#define TILTHEX_ADMITTANCE_WORDS 900

// Words of 8 bytes of a `TilthexAllocator`.
#define TILTHEX_ALLOCATOR_WORDS 450

// Words of 8 bytes of a `TilthexController`.
#define TILTHEX_CONTROLLER_WORDS 3600

// Words of 8 bytes of a `TilthexEstimator`.
#define TILTHEX_ESTIMATOR_WORDS 5000

// Words of 8 bytes of a `TilthexPlant`.
#define TILTHEX_PLANT_WORDS 560

// Most rotors of a vehicle, and the length of every array with one number for each rotor.
#define TILTHEX_MAX_ROTORS 12

// The answer of every function. Unless it is `TILTHEX_STATUS_OK`, the function has changed nothing.
typedef enum {
    // Done.
    TILTHEX_STATUS_OK = 0,
    // A pointer is null.
    TILTHEX_STATUS_NULL = 1,
    // The block has not been initialised.
    TILTHEX_STATUS_NOT_READY = 2,
    // A parameter is not possible; the message says which, and what is expected.
    TILTHEX_STATUS_REFUSED = 3,
    // A number is NaN or infinite, or would be in the result.
    TILTHEX_STATUS_NOT_FINITE = 4,
    // A matrix is not a rotation: its columns are not orthonormal within 1e-6, or its determinant is not +1.
    TILTHEX_STATUS_NOT_ROTATION = 5,
    // The time of a step is not from 0 to 1 s.
    TILTHEX_STATUS_PERIOD = 6,
} TilthexStatus;

// What the estimator did with a pose.
typedef enum {
    // Position and rotation were applied.
    TILTHEX_OUTCOME_ACCEPTED = 0,
    // They were applied with a larger noise.
    TILTHEX_OUTCOME_WEIGHED = 1,
    // Only the position was applied.
    TILTHEX_OUTCOME_POSITION_ONLY = 2,
    // Nothing was applied: it contradicts the state.
    TILTHEX_OUTCOME_REJECTED = 3,
    // It is applied in a later tick.
    TILTHEX_OUTCOME_PENDING = 4,
    // It is older than 0.3 s.
    TILTHEX_OUTCOME_TOO_OLD = 5,
    // A pose of the same time has arrived before.
    TILTHEX_OUTCOME_DUPLICATE = 6,
    // Not finite, or not a rotation.
    TILTHEX_OUTCOME_INVALID = 7,
    // No pose has started the estimator.
    TILTHEX_OUTCOME_UNINITIALIZED = 8,
} TilthexOutcome;

// One rotor, fixed to the airframe.
typedef struct {
    // Centre of rotation from the centre of mass, m, robot coordinates.
    double position_r[3];
    // Direction of the thrust, unit vector, robot coordinates.
    double axis_r[3];
    // +1 or -1: the sign of the drag moment about the thrust axis at positive speed.
    double spin;
    // Thrust coefficient, N/Hz^2.
    double thrust_coefficient;
    // Drag-moment coefficient, N m/Hz^2.
    double drag_coefficient;
    // Lowest speed, Hz.
    double min_speed;
    // Highest speed, Hz.
    double max_speed;
} TilthexRotor;

// A pose that is fixed on the robot.
typedef struct {
    // Its origin from the centre of mass, m, robot coordinates.
    double position_r[3];
    // Its orientation: maps its own coordinates to robot coordinates; `rotation_r[row][column]`.
    double rotation_r[3][3];
} TilthexMounting;

// A vehicle. Every init function that takes one checks it.
typedef struct {
    // Mass of vehicle and tool, kg.
    double mass;
    // Inertia about the centre of mass, kg m^2, robot coordinates; `inertia[row][column]`, symmetric.
    double inertia[3][3];
    // Number of rotors, at most `TILTHEX_MAX_ROTORS`.
    uint32_t rotor_count;
    // The rotors; those after `rotor_count` are not read.
    TilthexRotor rotors[TILTHEX_MAX_ROTORS];
    // Time constant of the first-order lag of the rotor speeds, s.
    double rotor_time_constant;
    // The tool: its tip, and its axes.
    TilthexMounting tool;
    // The inertial sensor.
    TilthexMounting imu;
} TilthexVehicle;

// Why a parameter is refused, in one sentence that ends with a zero byte; empty if nothing is refused.
typedef struct {
    // ASCII.
    char text[TILTHEX_MESSAGE_LENGTH];
} TilthexMessage;

// The wrench observer of a vehicle, and its state. Its memory belongs to the caller, and it can be copied.
typedef struct {
    // Not for the caller.
    uint64_t words[TILTHEX_OBSERVER_WORDS];
} TilthexObserver;

// Gains of the wrench observer.
typedef struct {
    // Rate at which the force estimate follows, 1/s, world axes.
    double force[3];
    // Rate at which the torque estimate follows, 1/s, robot axes.
    double torque[3];
} TilthexObserverGains;

// What is measured of the robot: the output of estimator and plant, and the input of observer and controller.
typedef struct {
    // Position of the centre of mass, m, world.
    double position_w[3];
    // Its velocity, m/s, world.
    double velocity_w[3];
    // Orientation: maps robot coordinates to world coordinates.
    double rotation_wr[3][3];
    // Angular velocity, rad/s, robot coordinates.
    double angular_velocity_r[3];
    // Specific force (acceleration minus gravity) at the centre of mass, m/s^2, robot coordinates.
    double specific_force_r[3];
    // Rotor speeds, Hz; those after the vehicle's count are zero. The estimator leaves them as they are.
    double rotor_speeds[TILTHEX_MAX_ROTORS];
} TilthexMeasured;

// A force and a torque. The field or the argument that holds it says the coordinates and the point of the torque.
typedef struct {
    // Force, N.
    double force[3];
    // Torque, N m.
    double torque[3];
} TilthexWrench;

// An admittance filter, and its state. Its memory belongs to the caller, and it can be copied.
typedef struct {
    // Not for the caller.
    uint64_t words[TILTHEX_ADMITTANCE_WORDS];
} TilthexAdmittance;

// Mass, damping and stiffness at the tool, translation before rotation, and limits.
typedef struct {
    // 0: the axes of the matrices are those of the world; otherwise those of the tool at its set-point.
    uint32_t tool_axes;
    // kg and kg m^2; positive definite.
    double mass[6][6];
    // N s/m and N m s/rad; positive semi-definite.
    double damping[6][6];
    // N/m and N m/rad; positive semi-definite.
    double stiffness[6][6];
    // Largest distance of the reference from the set-point, m.
    double max_translation;
    // Largest rotation of the reference from the set-point, rad; below pi.
    double max_rotation;
} TilthexAdmittanceParams;

// A pose of the tool with its motion, and the wrench that the tool exerts: a set-point, or the reference that has
// yielded from it.
typedef struct {
    // Position of the tool tip, m, world.
    double position_w[3];
    // Orientation of the tool: maps tool coordinates to world coordinates.
    double rotation_we[3][3];
    // Velocity of the tool tip, m/s, world.
    double velocity_w[3];
    // Angular velocity, rad/s, world.
    double angular_velocity_w[3];
    // Acceleration of the tool tip, m/s^2, world.
    double acceleration_w[3];
    // Angular acceleration, rad/s^2, world.
    double angular_acceleration_w[3];
    // Wrench that the tool exerts on the environment, world, about the tool tip.
    TilthexWrench wrench_w;
    // Bits 0 to 5: along x, y, z or about x, y, z of the tool, this wrench is controlled instead of the pose.
    uint32_t force_axes;
} TilthexSetpoint;

// The allocator of a vehicle, and its state. Its memory belongs to the caller, and it can be copied.
typedef struct {
    // Not for the caller.
    uint64_t words[TILTHEX_ALLOCATOR_WORDS];
} TilthexAllocator;

// What the allocator needs in a step.
typedef struct {
    // Wanted wrench of the rotors, robot coordinates, torque about the centre of mass.
    TilthexWrench wrench_r;
    // Orientation: maps robot coordinates to world coordinates.
    double rotation_wr[3][3];
    // Measured rotor speeds, Hz; used if the horizon is not 0.
    double rotor_speeds[TILTHEX_MAX_ROTORS];
    // Bit `i` is set if rotor `i` (from 0) is lost and stands still.
    uint32_t lost_rotors;
} TilthexAllocatorInput;

// Rotor speeds for a wrench, and the parts of the wrench that they do not produce.
typedef struct {
    // Rotor speeds, Hz; those after the vehicle's count are zero.
    double rotor_speeds[TILTHEX_MAX_ROTORS];
    // The wrench that they produce: force and torque, robot coordinates.
    double wrench_r[6];
    // Missing roll and pitch torque (N m), vertical force (N), yaw torque (N m), lateral force (N).
    double shortfall[4];
    // 1 if a limit is active that changes the speeds, otherwise 0.
    uint32_t saturated;
} TilthexAllocation;

// Parameters of the controller. Those of the core that are not here have their defaults.
typedef struct {
    // Gain on the position error, 1/s^2, world axes.
    double position_gain[3];
    // Gain on the velocity error, 1/s, world axes.
    double velocity_gain[3];
    // Gain on the rotation error, 1/s^2, robot axes.
    double rotation_gain[3];
    // Gain on the angular velocity error, 1/s, robot axes.
    double angular_velocity_gain[3];
    // The wrench observer.
    TilthexObserverGains observer;
    // The admittance filter.
    TilthexAdmittanceParams admittance;
    // Tool forces up to this norm, N, do not move the reference.
    double force_dead_zone;
    // Tool torques up to this norm, N m, do not turn the reference.
    double torque_dead_zone;
    // Cut-off of the low-pass before the dead zones, Hz; 0 for none.
    double low_pass_hz;
    // Speeds are limited to those that the rotors can reach within this time, s; 0 for no such limit.
    double horizon;
} TilthexControllerParams;

// The controller of a vehicle, and its state. Its memory belongs to the caller, and it can be copied.
typedef struct {
    // Not for the caller.
    uint64_t words[TILTHEX_CONTROLLER_WORDS];
} TilthexController;

// What the controller needs in a step.
typedef struct {
    // State of the robot, specific force and rotor speeds.
    TilthexMeasured measured;
    // The set-point of the tool.
    TilthexSetpoint setpoint;
    // Not 0: contact moves the reference. 0: it does not, and the reference moves back to the set-point.
    uint32_t compliant;
    // Not 0: a hover without contact, from which the bias of the observed wrench is learnt; it counts when this
    // becomes 0.
    uint32_t learn_bias;
    // Not 0: take-off or landing. The observed wrench is compensated only as far as errors of the model explain it, and
    // the vertical force of the rotors is between `least_lift` and `most_lift`.
    uint32_t unyielding;
    // Smallest vertical force of the rotors, N, if `unyielding`.
    double least_lift;
    // Largest vertical force of the rotors, N, if `unyielding`.
    double most_lift;
    // Bit `i` is set if rotor `i` (from 0) is lost and stands still.
    uint32_t lost_rotors;
} TilthexControllerInput;

// The command, and the values from which it follows.
typedef struct {
    // Commanded rotor speeds, Hz; those after the vehicle's count are zero.
    double rotor_speeds[TILTHEX_MAX_ROTORS];
    // Observed external wrench: force in world, torque in robot coordinates about the centre of mass; bias included.
    TilthexWrench wrench_robot;
    // Observed external wrench at the tool, world, without the bias.
    TilthexWrench wrench_tool_w;
    // Input of the admittance filter: after low-pass and dead zones, world.
    TilthexWrench wrench_admittance_w;
    // Reference of the tool, which has yielded.
    TilthexSetpoint reference;
    // What the allocator found.
    TilthexAllocation allocation;
    // 1 if the reference is at its largest distance from the set-point, otherwise 0.
    uint32_t excursion_limited;
} TilthexControllerOutput;

// Parameters of the estimator. Those of the core that are not here have their defaults.
typedef struct {
    // White noise of the gyro, rad/s/sqrt(Hz).
    double gyro_noise;
    // White noise of the accelerometer, m/s^2/sqrt(Hz).
    double accelerometer_noise;
    // Random walk of the gyro's bias, rad/s/sqrt(s).
    double gyro_bias_noise;
    // Random walk of the accelerometer's bias, m/s^2/sqrt(s).
    double accelerometer_bias_noise;
    // Standard deviation of a captured position, m per axis.
    double position_noise;
    // Standard deviation of a captured orientation, rad per axis.
    double rotation_noise;
    // The inertial sensor.
    TilthexMounting imu;
    // The captured body.
    TilthexMounting body;
    // Constant latency that is subtracted from the time of every pose, s.
    double latency;
} TilthexEstimatorParams;

// An estimator. Its memory belongs to the caller, and it can be copied.
typedef struct {
    // Not for the caller.
    uint64_t words[TILTHEX_ESTIMATOR_WORDS];
} TilthexEstimator;

// A captured pose.
typedef struct {
    // When it was taken, s, on the clock of the inertial samples.
    double time;
    // When it arrived, s, on that clock.
    double arrival;
    // Position of the captured body, m, world.
    double position_w[3];
    // Orientation of the captured body: maps its coordinates to world coordinates.
    double rotation_wc[3][3];
} TilthexPose;

// How far the state can be trusted.
typedef struct {
    // 0: not started; 1: tracking; 2: without poses for so long that it only follows the inertial samples; 3: lost.
    uint32_t status;
    // Age of the newest pose whose position, at least, was accepted, s.
    double position_age;
    // Root of the summed variances of the position, m.
    double position_deviation;
    // The same for the velocity, m/s.
    double velocity_deviation;
    // The same for the rotation, rad.
    double rotation_deviation;
} TilthexHealth;

// A simulated vehicle. Its memory belongs to the caller, and it can be copied.
typedef struct {
    // Not for the caller.
    uint64_t words[TILTHEX_PLANT_WORDS];
} TilthexPlant;

// The true state of the simulated vehicle, and what a perfect inertial sensor reads.
typedef struct {
    // State of the centre of mass, specific force there, and rotor speeds.
    TilthexMeasured measured;
    // Angular velocity at the inertial sensor, rad/s, its coordinates.
    double gyro_i[3];
    // Specific force at the inertial sensor, m/s^2, its coordinates.
    double specific_force_i[3];
    // Position of the tool tip, m, world.
    double tool_position_w[3];
    // Orientation of the tool: maps tool coordinates to world coordinates.
    double tool_rotation_we[3][3];
} TilthexPlantState;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The sentence of a `TilthexStatus`: static, ends with a zero byte.
const char *tilthex_status_text(int32_t status);

// Writes the numbers of the Tilt-Hex: six tilted rotors, 2.4 kg, a tool 0.4 m below the centre of mass (Ryll et al.,
// IJRR 38(9), 2019, table 1).
TilthexStatus tilthex_vehicle_tilt_hex(TilthexVehicle *vehicle);

// Checks a vehicle. `message` (may be null) gets the sentence of a refusal.
TilthexStatus tilthex_vehicle_check(const TilthexVehicle *vehicle, TilthexMessage *message);

// Makes a wrench observer for a vehicle. `message` (may be null) gets the sentence of a refusal.
TilthexStatus tilthex_observer_init(TilthexObserver *observer,
                                    const TilthexVehicle *vehicle,
                                    const TilthexObserverGains *gains,
                                    TilthexMessage *message);

// Takes the sample at the end of a period of `dt` s (0 to 1) and writes the external wrench: force in world, torque in
// robot coordinates about the centre of mass, which the environment exerts on the robot. The first sample only marks
// the start. The position and the velocity of the sample are not used.
TilthexStatus tilthex_observer_step(TilthexObserver *observer,
                                    const TilthexMeasured *measured,
                                    double dt,
                                    TilthexWrench *wrench);

// Makes an admittance filter for steps of about `period` s; steps of another period take several times as long.
// `message` (may be null) gets the sentence of a refusal.
TilthexStatus tilthex_admittance_init(TilthexAdmittance *admittance,
                                      const TilthexAdmittanceParams *params,
                                      double period,
                                      TilthexMessage *message);

// Moves the reference by `dt` s (0 to 1) under a wrench at the tool (world), and writes it. Where nothing pushes, spring
// and damper move it back to the set-point.
TilthexStatus tilthex_admittance_step(TilthexAdmittance *admittance,
                                      const TilthexSetpoint *setpoint,
                                      const TilthexWrench *wrench_w,
                                      double dt,
                                      TilthexSetpoint *reference);

// Makes the allocator of a vehicle. Speeds are limited to those that the rotors can reach within `horizon` s; 0 for no
// such limit. `message` (may be null) gets the sentence of a refusal.
TilthexStatus tilthex_allocator_init(TilthexAllocator *allocator,
                                     const TilthexVehicle *vehicle,
                                     double horizon,
                                     TilthexMessage *message);

// Finds the rotor speeds for a wrench. What the limits do not allow is given up in the order lateral force, yaw torque,
// vertical force, roll and pitch torque.
TilthexStatus tilthex_allocator_step(TilthexAllocator *allocator,
                                     const TilthexAllocatorInput *input,
                                     TilthexAllocation *allocation);

// Writes the default parameters, which fit the Tilt-Hex.
TilthexStatus tilthex_controller_defaults(TilthexControllerParams *params);

// Makes the controller of a vehicle for steps of about `period` s; steps of another period take longer. `message` (may
// be null) gets the sentence of a refusal.
TilthexStatus tilthex_controller_init(TilthexController *controller,
                                      const TilthexVehicle *vehicle,
                                      const TilthexControllerParams *params,
                                      double period,
                                      TilthexMessage *message);

// One tick: observer, admittance filter, pose controller, allocator. `dt` is the measured time since the last tick,
// s (0 to 1). `output` is changed only if the status is `TILTHEX_STATUS_OK`; otherwise hold the last speeds, or land.
TilthexStatus tilthex_controller_step(TilthexController *controller,
                                      const TilthexControllerInput *input,
                                      double dt,
                                      TilthexControllerOutput *output);

// Writes the default parameters: a good MEMS IMU and an optical capture system, both at the centre of mass.
TilthexStatus tilthex_estimator_defaults(TilthexEstimatorParams *params);

// Makes an estimator that waits for a start. `message` (may be null) gets the sentence of a refusal.
TilthexStatus tilthex_estimator_init(TilthexEstimator *estimator,
                                     const TilthexEstimatorParams *params,
                                     TilthexMessage *message);

// Starts from a pose. If `at_rest` is not 0, the biases of the inertial sensor are found from the samples of the last
// second, in which the vehicle must stand still; otherwise they begin at zero. `message` (may be null) gets the
// sentence of a refusal.
TilthexStatus tilthex_estimator_start(TilthexEstimator *estimator,
                                      const TilthexPose *pose,
                                      uint32_t at_rest,
                                      TilthexMessage *message);

// Takes an inertial sample at `time` (s): rate (rad/s, `gyro_i[3]`) and specific force (m/s^2, `specific_force_i[3]`)
// in the coordinates of the sensor.
TilthexStatus tilthex_estimator_predict(TilthexEstimator *estimator,
                                        double time,
                                        const double *gyro_i,
                                        const double *specific_force_i);

// Takes a pose, which may be late: it is applied at the time at which it was taken. `outcome` (may be null) gets what
// was done with it.
TilthexStatus tilthex_estimator_update(TilthexEstimator *estimator,
                                       const TilthexPose *pose,
                                       TilthexOutcome *outcome);

// Writes the state of the centre of mass and the specific force there at the newest sample into `measured`, whose rotor
// speeds stay, and how far they can be trusted into `health` (may be null).
TilthexStatus tilthex_estimator_state(TilthexEstimator *estimator,
                                      TilthexMeasured *measured,
                                      TilthexHealth *health);

// Makes a simulated vehicle, a rigid body with rotor lag, that hovers level with its centre of mass at
// `position_w[3]` (m, world). `message` (may be null) gets the sentence of a refusal.
TilthexStatus tilthex_plant_init(TilthexPlant *plant,
                                 const TilthexVehicle *vehicle,
                                 const double *position_w,
                                 TilthexMessage *message);

// Moves the vehicle by `dt` s (0 to 1) under commanded speeds (Hz, `rotor_speeds[TILTHEX_MAX_ROTORS]`) and a wrench that
// the environment exerts on the tool (world, about its tip; null for none).
TilthexStatus tilthex_plant_step(TilthexPlant *plant,
                                 const double *rotor_speeds,
                                 const TilthexWrench *wrench_tool_w,
                                 double dt);

// Writes the present state, under the wrench of the last step.
TilthexStatus tilthex_plant_state(TilthexPlant *plant, TilthexPlantState *state);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* TILTHEX_H */
