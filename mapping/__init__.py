"""From stamped scans to a map: geometry, occupancy grids, odometry, live SLAM and map files."""
