"""The keyboard as a controller: a hand that moves at a speed."""
