/* {{ name }}_tables.h: constants of the chain.
 *
 * {{ banner }}
 */
#ifndef {{ NAME }}_TABLES_H
#define {{ NAME }}_TABLES_H

#include <stdint.h>

{% for table in tables %}
/* {{ table.help }} */
static const {{ table.type }} {{ table.name }}[{{ table.length }}]{{ "[2]" if table.is_complex }} = {
{% for line in table.lines %}
    {{ line }}
{% endfor %}
};

{% endfor %}
#endif
