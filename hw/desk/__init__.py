"""Controllers on a desk: keyboard, gamepad and 3D mouse, each as a hand that moves at a speed."""
