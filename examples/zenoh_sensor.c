/* A sensor in C: publishes a scan with one detection each second, and prints the service's notices.

   cc zenoh_sensor.c -DZENOH_LINUX -lzenohpico -o zenoh_sensor     (zenoh-pico 1.7 or later)
   ./zenoh_sensor tcp/127.0.0.1:7447 prescribed
   Keys and records: docs/zenoh.md; the scan: docs/sensors.md. */
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include <zenoh-pico.h>

static const char SCAN[] =
    "{\"sensor\":{\"name\":\"radar-c\",\"detection_probability\":0.95,\"clutter_density_per_m2\":5e-6,"
    "\"noise_cov_m2\":[[10,0],[0,10]],\"field_of_view_m\":[0,0,2000,2000]},"
    "\"origin\":{\"lat_deg\":33.2,\"lon_deg\":-87.6},\"measured_t_ns\":%lld,\"z_m\":[[%.1f,880.0]]}";

static void print_notice(z_loaned_sample_t *sample, void *unused) {
    z_owned_string_t text;
    (void)unused;
    if (z_bytes_to_string(z_sample_payload(sample), &text) < 0) return;
    printf("%.*s\n", (int)z_string_len(z_loan(text)), z_string_data(z_loan(text)));
    fflush(stdout);
    z_drop(z_move(text));
}

int main(int argc, char **argv) {
    char notices[128], scans[128], payload[1024];
    z_owned_config_t config;
    z_owned_session_t session;
    z_owned_closure_sample_t on_notice;
    z_owned_subscriber_t subscriber;
    z_view_keyexpr_t key;

    if (argc != 3) return fprintf(stderr, "usage: zenoh_sensor ENDPOINT MISSION\n"), 2;
    snprintf(notices, sizeof notices, "swarm/%s/notice", argv[2]);
    snprintf(scans, sizeof scans, "swarm/%s/sensor/radar-c/scan", argv[2]);

    z_config_default(&config);
    zp_config_insert(z_loan_mut(config), Z_CONFIG_CONNECT_KEY, argv[1]);
    if (z_open(&session, z_move(config), NULL) < 0) return fprintf(stderr, "no service at %s\n", argv[1]), 1;

    z_closure(&on_notice, print_notice, NULL, NULL);
    if (z_view_keyexpr_from_str(&key, notices) < 0 ||
        z_declare_subscriber(z_loan(session), &subscriber, z_loan(key), z_move(on_notice), NULL) < 0)
        return fprintf(stderr, "cannot subscribe to %s\n", notices), 1;

    if (z_view_keyexpr_from_str(&key, scans) < 0) return 1;
    for (int second = 0;; ++second) {
        struct timespec now;
        z_owned_bytes_t bytes;
        z_put_options_t options;
        clock_gettime(CLOCK_REALTIME, &now);
        snprintf(payload, sizeof payload, SCAN, now.tv_sec * 1000000000LL + now.tv_nsec, 100.0 + 5.0 * second);
        z_bytes_copy_from_str(&bytes, payload);
        z_put_options_default(&options);
        options.congestion_control = Z_CONGESTION_CONTROL_BLOCK;
        if (z_put(z_loan(session), z_loan(key), z_move(bytes), &options) < 0) return 1;
        sleep(1);
    }
}
