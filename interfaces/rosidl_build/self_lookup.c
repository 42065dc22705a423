/* Type support lookup inside one library.
 *
 * The original rosidl_typesupport_c finds an implementation by dlopen("lib<package>__<typesupport>.so"), which needs five
 * libraries per package and LD_LIBRARY_PATH. Here a package is linked into one Python extension module, so the symbol is looked
 * up in the library that contains this function. Compiler flags (native.py) replace the original functions of
 * rosidl_typesupport_c/{message,service}_type_support_dispatch.h by the two below.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stddef.h>
#include <string.h>

#include "rcutils/error_handling.h"
#include "rosidl_runtime_c/message_type_support_struct.h"
#include "rosidl_runtime_c/service_type_support_struct.h"
#include "rosidl_typesupport_c/identifier.h"
#include "rosidl_typesupport_c/type_support_map.h"

#define HIDDEN __attribute__((visibility("hidden")))

static void * own_library(void)
{
  static void * library = NULL;
  Dl_info info;
  if (library == NULL && dladdr((void *)own_library, &info) != 0) {
    library = dlopen(info.dli_fname, RTLD_NOW | RTLD_NOLOAD);
  }
  return library;
}

static void * find_symbol(const type_support_map_t * map, const char * identifier)
{
  void * library = own_library();
  for (size_t i = 0; library != NULL && i < map->size; ++i) {
    if (strcmp(map->typesupport_identifier[i], identifier) == 0) {
      return dlsym(library, map->symbol_name[i]);
    }
  }
  RCUTILS_SET_ERROR_MSG_WITH_FORMAT_STRING("package '%s' has no type support '%s'", map->package_name, identifier);
  return NULL;
}

HIDDEN const rosidl_message_type_support_t * rosidl_build_message_type_support(
  const rosidl_message_type_support_t * handle, const char * identifier)
{
  typedef const rosidl_message_type_support_t * (*getter_t)(void);
  if (strcmp(identifier, rosidl_typesupport_c__typesupport_identifier) == 0) {
    return handle;
  }
  getter_t getter = (getter_t)find_symbol(handle->data, identifier);
  return getter != NULL ? getter() : NULL;
}

HIDDEN const rosidl_service_type_support_t * rosidl_build_service_type_support(
  const rosidl_service_type_support_t * handle, const char * identifier)
{
  typedef const rosidl_service_type_support_t * (*getter_t)(void);
  if (strcmp(identifier, rosidl_typesupport_c__typesupport_identifier) == 0) {
    return handle;
  }
  getter_t getter = (getter_t)find_symbol(handle->data, identifier);
  return getter != NULL ? getter() : NULL;
}
