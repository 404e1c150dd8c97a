// Needs: nothing.
// Gives: kPi, kInvPi, saturate().
const float kPi = 3.14159265358979;
const float kInvPi = 0.318309886183791;

float saturate(float x) { return clamp(x, 0.0, 1.0); }
