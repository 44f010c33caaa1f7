/* The simulated Tilt-Hex hovers; at 1 s something pushes its tool for 6 s. The tool yields like a spring.
 *
 *     cargo build --release -p tilthex-c
 *     gcc -Icrates/tilthex-c/include crates/tilthex-c/examples/hover_and_push.c target/release/libtilthex_c.a -lm
 */
#include <stdio.h>
#include <stdlib.h>

#include "tilthex.h"

#define PERIOD 0.002

/* A block is large: static, not on a small stack. */
static TilthexController controller;
static TilthexEstimator estimator;
static TilthexPlant plant;

static void check(TilthexStatus status, const TilthexMessage *message)
{
    if (status != TILTHEX_STATUS_OK) {
        int told = message != NULL && message->text[0] != '\0';
        fprintf(stderr, "%s\n", told ? message->text : tilthex_status_text(status));
        exit(1);
    }
}

int main(void)
{
    TilthexMessage message;
    TilthexVehicle vehicle;
    TilthexControllerParams params;
    TilthexEstimatorParams estimator_params;
    const double start[3] = {0.0, 0.0, 1.0};

    check(tilthex_vehicle_tilt_hex(&vehicle), NULL);
    check(tilthex_controller_defaults(&params), NULL);
    check(tilthex_estimator_defaults(&estimator_params), NULL);
    check(tilthex_controller_init(&controller, &vehicle, &params, PERIOD, &message), &message);
    check(tilthex_estimator_init(&estimator, &estimator_params, &message), &message);
    check(tilthex_plant_init(&plant, &vehicle, start, &message), &message);

    TilthexPlantState truth;
    check(tilthex_plant_state(&plant, &truth), NULL);
    TilthexPose pose = {0};
    for (int row = 0; row < 3; row++) {
        pose.position_w[row] = start[row];
        pose.rotation_wc[row][row] = 1.0;
    }
    check(tilthex_estimator_start(&estimator, &pose, 0, &message), &message);

    TilthexControllerInput input = {0};
    for (int row = 0; row < 3; row++) {
        input.setpoint.position_w[row] = truth.tool_position_w[row];
        input.setpoint.rotation_we[row][row] = 1.0;
    }
    input.compliant = 1;

    printf("time  push  observed  reference  tool\n");
    printf("   s     N         N          m     m\n");
    for (int tick = 1; tick <= 4500; tick++) {
        double time = tick * PERIOD;
        TilthexWrench push = {{0.0}, {0.0}};
        push.force[0] = time > 1.0 && time <= 7.0 ? 1.4 : 0.0;

        check(tilthex_estimator_predict(&estimator, time, truth.gyro_i, truth.specific_force_i), NULL);
        if (tick % 5 == 0) { /* motion capture at 100 Hz */
            TilthexOutcome outcome;
            pose.time = pose.arrival = time;
            for (int row = 0; row < 3; row++) {
                pose.position_w[row] = truth.measured.position_w[row];
                for (int column = 0; column < 3; column++) {
                    pose.rotation_wc[row][column] = truth.measured.rotation_wr[row][column];
                }
            }
            check(tilthex_estimator_update(&estimator, &pose, &outcome), NULL);
        }
        input.measured = truth.measured; /* the rotor speeds */
        check(tilthex_estimator_state(&estimator, &input.measured, NULL), NULL);

        TilthexControllerOutput output;
        check(tilthex_controller_step(&controller, &input, PERIOD, &output), NULL);
        check(tilthex_plant_step(&plant, output.rotor_speeds, &push, PERIOD), NULL);
        check(tilthex_plant_state(&plant, &truth), NULL);

        if (tick % 500 == 0) {
            printf("%4.1f  %4.1f  %8.3f  %9.4f  %.4f\n", time, push.force[0], output.wrench_tool_w.force[0],
                   output.reference.position_w[0] - input.setpoint.position_w[0],
                   truth.tool_position_w[0] - input.setpoint.position_w[0]);
        }
    }
    return 0;
}
