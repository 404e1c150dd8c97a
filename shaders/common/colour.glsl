// Needs: nothing.
// Gives: colourToNormal(), normalToColour() between [0, 1] and [-1, 1]; linearToSrgb() (IEC 61966-2-1).
vec3 colourToNormal(vec3 colour) { return 2.0 * colour - 1.0; }

vec3 normalToColour(vec3 normal) { return 0.5 * normal + 0.5; }

vec3 linearToSrgb(vec3 linear) {
  vec3 low = 12.92 * linear;
  vec3 high = 1.055 * pow(linear, vec3(1.0 / 2.4)) - 0.055;
  return mix(high, low, vec3(lessThanEqual(linear, vec3(0.0031308))));
}
