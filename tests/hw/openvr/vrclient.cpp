// The part of a SteamVR runtime that libopenvr_api loads: enough to hand out function tables.
//
// libopenvr_api finds this library through the path registry, asks its factory for the client
// core and forwards VR_Init, VR_GetGenericInterface and VR_Shutdown to it. The tables come from
// the test, which calls set_provider before it initialises.

#include <cstring>

namespace {

constexpr int kNone = 0;
constexpr int kInterfaceNotFound = 105;  // VRInitError_Init_InterfaceNotFound

using InitError = int (*)(int application);
using Interface = void *(*)(const char *name);

InitError g_init_error = nullptr;
Interface g_interface = nullptr;

const char *without_prefix(const char *name) {
  constexpr char prefix[] = "FnTable:";
  constexpr std::size_t length = sizeof(prefix) - 1;
  return std::strncmp(name, prefix, length) == 0 ? name + length : name;
}

// The order of the virtual functions is the interface IVRClientCore_003.
class ClientCore {
 public:
  virtual int Init(int application, const char *) {
    return g_init_error ? g_init_error(application) : kInterfaceNotFound;
  }
  virtual void Cleanup() {}
  virtual int IsInterfaceVersionValid(const char *name) {
    return find(name) ? kNone : kInterfaceNotFound;
  }
  virtual void *GetGenericInterface(const char *name, int *error) {
    void *found = find(name);
    if (error) *error = found ? kNone : kInterfaceNotFound;
    return found;
  }
  virtual bool BIsHmdPresent() { return true; }
  virtual const char *GetEnglishStringForHmdError(int) { return "an error"; }
  virtual const char *GetIDForVRInitError(int) { return "VRInitError"; }

 private:
  static void *find(const char *name) {
    return g_interface ? g_interface(without_prefix(name)) : nullptr;
  }
};

ClientCore g_core;

}  // namespace

extern "C" {

__attribute__((visibility("default"))) void *VRClientCoreFactory(const char *name, int *error) {
  const bool known = std::strcmp(name, "IVRClientCore_003") == 0;
  if (error) *error = known ? kNone : kInterfaceNotFound;
  return known ? &g_core : nullptr;
}

__attribute__((visibility("default"))) void set_provider(InitError init_error,
                                                         Interface interface) {
  g_init_error = init_error;
  g_interface = interface;
}
}
