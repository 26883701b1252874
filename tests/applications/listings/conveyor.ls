/PROG  CONVEYOR
/ATTR
OWNER		= MNEDITOR;
COMMENT		= "";
PROG_SIZE	= 1204;
PROTECT		= READ_WRITE;
TCD:  STACK_SIZE	= 0,
      TASK_PRIORITY	= 50;
DEFAULT_GROUP	= 1,*,*,*,*;
CONTROL_CODE	= 00000000 00000000;
/APPL
  LINE_TRACK ;
  LINE_TRACK_SCHEDULE_NUMBER	: 1 ;
/MN
   1:J P[1] 20% FINE    ;
   2:L P[2] 100mm/sec FINE    ;
   3:  STOP_TRACKING ;
/POS
P[1]{
   GP1:
	UF : 2, UT : 3,	
	J1=    27.252 deg,	J2=    35.150 deg,	J3=    -7.038 deg,
	J4=    -1.946 deg,	J5=    58.403 deg,	J6=    10.724 deg
};
P[2]{
   GP1:
	UF : 2, UT : 3,		CONFIG : 'N U T, 0, 0, 0',
	X =   258.739  mm,	Y =  1872.358  mm,	Z =  2142.529  mm,
	W =   -40.279 deg,	P =   -50.319 deg,	R =   121.524 deg
};
/END
