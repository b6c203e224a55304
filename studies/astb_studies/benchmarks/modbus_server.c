/* The Modbus/TCP server of libmodbus: answers whoever connects from a map of zeros, one client at a time.
 *
 * modbus_server    prints its port; ends when it is killed. libmodbus' own header is not needed to compile this.
 */
#include <arpa/inet.h>
#include <netinet/in.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/socket.h>

typedef struct _modbus modbus_t;
typedef struct _modbus_mapping modbus_mapping_t;
modbus_t *modbus_new_tcp(const char *address, int port);
modbus_mapping_t *modbus_mapping_new(int bits, int input_bits, int registers, int input_registers);
int modbus_tcp_listen(modbus_t *context, int connections);
int modbus_tcp_accept(modbus_t *context, int *socket);
int modbus_receive(modbus_t *context, uint8_t *request);
int modbus_reply(modbus_t *context, const uint8_t *request, int length, modbus_mapping_t *map);

int main(void)
{
    uint8_t request[260];
    struct sockaddr_in address;
    socklen_t size = sizeof address;
    modbus_t *context = modbus_new_tcp("127.0.0.1", 0);
    modbus_mapping_t *map = modbus_mapping_new(1, 1, 1000, 1000);
    int listening = context ? modbus_tcp_listen(context, 1) : -1;
    if (!map || listening < 0 || getsockname(listening, (struct sockaddr *)&address, &size) != 0) return 1;
    printf("%d\n", ntohs(address.sin_port));
    fflush(stdout);
    for (;;) {
        int length;
        if (modbus_tcp_accept(context, &listening) < 0) return 1;
        while ((length = modbus_receive(context, request)) >= 0)
            if (length > 0 && modbus_reply(context, request, length, map) < 0) break;
    }
}
