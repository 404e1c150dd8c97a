/* An OSMesa that is there, but gives no context of the wanted version: what lmc asks of it, and nothing else. */
void* OSMesaCreateContextAttribs(const int* wanted, void* shared) {
  (void)wanted, (void)shared;
  return 0;
}
unsigned char OSMesaMakeCurrent(void* context, void* window, unsigned type, int width, int height) {
  (void)context, (void)window, (void)type, (void)width, (void)height;
  return 0;
}
void OSMesaDestroyContext(void* context) { (void)context; }
void* OSMesaGetProcAddress(const char* name) {
  (void)name;
  return 0;
}
