/// Names of the metrics, the keys of `metrics` in `summary.json`, in its order. `expect` may bound any of them.
pub const METRICS: &[&str] = &[
    "images",
    "tip_rmse_px",
    "tip_p95_px",
    "tip_max_px",
    "tip_rmse_mm",
    "coverage",
    "losses",
    "recoveries",
    "detection_delay_s",
    "travel_after_loss_mm",
    "stop_delay_s",
    "recovery_time_s",
    "false_losses",
    "false_recoveries",
    "silent_loss_s",
    "plane_to_tip_rms_mm",
    "max_contact_force_n",
    "max_needle_force_n",
    "min_joint_margin_deg",
    "final_target_distance_mm",
    "success",
];

/// Those that are true or false; all others are numbers.
pub(crate) const TRUTH_VALUED: &[&str] = &["success"];
