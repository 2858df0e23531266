/* Names and numbers of this FMU: the same as in modelDescription.xml. */
#ifndef FMU_MODEL_H
#define FMU_MODEL_H
#include <float.h>
#include <math.h>
#include "SHIP.h"
#define FMU_TOKEN "{{ TOKEN }}"
#define {{ "SH" "IP" }}(name) SHIP_##name
/* settles the memory of a state whose first six are given: of the ship's source, included before */
#define FMU_SETTLE settle
{% for name, value in SIZES.items() %}
#define {{ name }} {{ value if value >= 0 else "(%d)" % value }}
{% endfor %}
{% for name, (count, numbers) in (("start", START), ("lower", LOWER), ("upper", HIGHEST)) %}
static const double fmu_{{ name }}[{{ count }}] = {
  {{ numbers }}};
{% endfor %}
#endif
