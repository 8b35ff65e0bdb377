//! NovAtel SPAN receivers (OEM4 to OEM7): binary logs in, poses, raw inertial data, positions and times out.
