/* Drives HOAP-3's protocol as its own programs did: init PORT, control PORT, order, slots, CHECK_TIME.
 *
 * Asks for CHECK_TIME * 1000 / 2 exchanges, commands where joint 0 is plus 10 counts, and prints how
 * many it had, and the last count of joint 0. */
#include <arpa/inet.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

static int connected(int port) {
    struct sockaddr_in place = {.sin_family = AF_INET, .sin_port = htons(port)};
    int tries = 200, end = socket(AF_INET, SOCK_STREAM, 0);
    inet_pton(AF_INET, "127.0.0.1", &place.sin_addr);
    while (connect(end, (struct sockaddr *)&place, sizeof place)) {
        struct timespec pause = {0, 50000000};
        if (!--tries) exit(2);
        nanosleep(&pause, NULL);
        close(end);
        end = socket(AF_INET, SOCK_STREAM, 0);
    }
    return end;
}

static void all_of(int end, double *frame, size_t size) {
    for (size_t done = 0; done < size;) {
        ssize_t got = read(end, (char *)frame + done, size - done);
        if (got <= 0) exit(3);
        done += got;
    }
}

int main(int count, char **words) {
    if (count != 6) return 1;
    int slots = atoi(words[4]), legacy = !strcmp(words[3], "legacy");
    size_t size = slots * sizeof(double);
    double beginning[2] = {2, atof(words[5])}, frame[22] = {0}, command[22] = {0};
    int exchanges = beginning[1] * 1000 / beginning[0], done = 0, first = connected(atoi(words[1]));
    if (write(first, beginning, sizeof beginning) != sizeof beginning) return 4;
    int end = connected(atoi(words[2]));
    close(first);
    for (; done < exchanges; done++) {
        if (legacy && write(end, command, size) != (ssize_t)size) return 5;
        all_of(end, frame, size);
        memcpy(command, frame, size);
        command[0] += 10;
        if (!legacy && write(end, command, size) != (ssize_t)size) return 5;
    }
    printf("%d %.0f\n", done, frame[0]);
    return 0;
}
