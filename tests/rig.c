/* Replays an episode: reads lines of t [s] and what is measured [SI], writes the commands [SI].

   cc -DPOLICY='"policy.c"' -DCHANNELS=5 -DCOMMANDS=1 tests/rig.c -o rig -lm; ./rig < episode.txt */
#include <stdio.h>
#include POLICY

int main(void) {
    policy_state state;
    REAL measured[CHANNELS], command[COMMANDS];
    double number;
    while (scanf("%lf", &number) == 1) {
        const REAL t = (REAL)number;
        for (int i = 0; i < CHANNELS; i++) {
            if (scanf("%lf", &number) != 1) return 1;
            measured[i] = (REAL)number;
        }
        if (policy_act_si(&state, measured, t, command) != 0) return 1;
        for (int i = 0; i < COMMANDS; i++) printf("%.17g ", (double)command[i]);
        printf("\n");
    }
    return 0;
}
